//! A controller and a pair of predictors that answer in time or not at all.

use std::time::Duration;

use vocaloco_plugin_api::{Command, JointTarget, RobotState};

use super::worker::{TooLate, Worker};
use crate::heightfield::Field;
use crate::plugin::StateBuffer;
use crate::runtime::{CallFault, Controller, Predict};
use crate::selector::Prediction;

/// A controller on a thread of its own.
pub(crate) struct WatchedController {
    worker: Worker<Call>,
    budget: Duration,
}

/// A call of a controller, and its answer.
struct Call {
    resets: bool,
    acts: bool,
    state: StateBuffer,
    command: Command,
    joints: Vec<JointTarget>,
    answer: Result<(), (&'static str, CallFault)>,
}

impl WatchedController {
    pub(crate) fn start(
        skill: &str,
        mut controller: Box<dyn Controller>,
        budget: Duration,
    ) -> std::io::Result<Self> {
        let call = Call {
            resets: false,
            acts: false,
            state: StateBuffer::default(),
            command: Command::velocity(0.0, 0.0, 0.0),
            joints: Vec::new(),
            answer: Ok(()),
        };
        let run = move |call: &mut Call| {
            let state = call.state.state();
            call.answer = match (call.resets, call.acts) {
                (true, true) => controller.begin(&state, &call.command, &mut call.joints),
                (true, false) => controller.reset(&state).map_err(|fault| ("reset", fault)),
                _ => controller.act(&state, &call.command, &mut call.joints).map_err(|fault| ("act", fault)),
            };
        };
        let panicked = |call: &mut Call, words: &str| {
            call.answer = Err(("act", CallFault::Failed(format!("panicked: {words}"))));
        };
        Ok(Self { worker: Worker::start(format!("act {skill}"), call, run, panicked)?, budget })
    }

    /// What a call answers within the budget; `resets` first, and acts where there are targets to fill.
    fn ask(
        &mut self,
        resets: bool,
        state: &RobotState<'_>,
        command: &Command,
        joints: Option<&mut [JointTarget]>,
    ) -> Result<(), (&'static str, CallFault)> {
        let (acts, budget) = (joints.is_some(), self.budget);
        let joints = joints.unwrap_or_default();
        let count = joints.len();
        let fill = |call: &mut Call| {
            (call.resets, call.acts) = (resets, acts);
            call.state.copy_from(state);
            call.command = *command;
            // What the controller leaves out is no number, as without a thread.
            call.joints.clear();
            let none = JointTarget { position_rad: f32::NAN, ..JointTarget::default() };
            call.joints.resize(count, none);
        };
        let answered = self.worker.ask(budget, fill, |call| {
            joints.copy_from_slice(&call.joints);
            call.answer.clone()
        });
        answered.unwrap_or_else(|TooLate| {
            let call = match (resets, acts) {
                (true, true) => "reset and act",
                (true, false) => "reset",
                _ => "act",
            };
            Err((call, CallFault::Overrun(budget)))
        })
    }
}

impl Controller for WatchedController {
    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), CallFault> {
        let standing = Command::velocity(0.0, 0.0, 0.0);
        self.ask(true, state, &standing, None).map_err(|(_, fault)| fault)
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault> {
        self.ask(false, state, command, Some(joints)).map_err(|(_, fault)| fault)
    }

    fn begin(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), (&'static str, CallFault)> {
        self.ask(true, state, command, Some(joints))
    }

    fn set_budget(&mut self, budget: Duration) {
        self.budget = budget;
    }
}

/// Predictors on a thread of their own.
pub(crate) struct WatchedPredictors {
    worker: Worker<Question>,
    budget: Duration,
}

/// A field, and what is predicted for it.
struct Question {
    field: Option<Field>,
    answer: (Prediction, Option<CallFault>),
}

impl WatchedPredictors {
    pub(crate) fn start(
        skill: &str,
        mut predictors: Box<dyn Predict>,
        budget: Duration,
    ) -> std::io::Result<Self> {
        let question = Question { field: None, answer: (Prediction::NONE, None) };
        let run = move |question: &mut Question| {
            if let Some(field) = &question.field {
                question.answer = predictors.predict(field);
            }
        };
        let panicked = |question: &mut Question, words: &str| {
            let fault = CallFault::Failed(format!("panicked: {words}"));
            question.answer = (Prediction::NONE, Some(fault));
        };
        Ok(Self { worker: Worker::start(format!("predict {skill}"), question, run, panicked)?, budget })
    }
}

impl Predict for WatchedPredictors {
    fn predict(&mut self, field: &Field) -> (Prediction, Option<CallFault>) {
        let fill = |question: &mut Question| question.field = Some(field.clone());
        let answered = self.worker.ask(self.budget, fill, |question| question.answer.clone());
        answered.unwrap_or((Prediction::NONE, Some(CallFault::Overrun(self.budget))))
    }

    fn set_budget(&mut self, budget: Duration) {
        self.budget = budget;
    }
}
