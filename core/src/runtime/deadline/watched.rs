//! A controller and a pair of predictors that answer in time or not at all.

use std::sync::Arc;
use std::time::Duration;

use vocaloco_plugin_api::{Command, JointTarget, RobotState};

use super::worker::{TooLate, Worker};
use crate::heightfield::Field;
use crate::plugin::StateBuffer;
use crate::runtime::background::Beside;
use crate::runtime::{CallFault, Controller, Predict};
use crate::selector::Prediction;

/// Longest time to start a process anew that has ended; no loop waits for it.
const REVIVAL: Duration = Duration::from_mins(1);

/// A controller on a thread of its own.
pub(crate) struct WatchedController {
    worker: Worker<Call>,
    /// The process that it runs in, where that is another.
    process: Arc<Beside>,
    budget: Duration,
}

/// A call of a controller, and its answer.
struct Call {
    what: What,
    state: StateBuffer,
    command: Command,
    joints: Vec<JointTarget>,
    answer: Result<(), (&'static str, CallFault)>,
}

#[derive(Clone, Copy)]
enum What {
    Reset,
    Act,
    ResetAndAct,
    Revive,
}

impl WatchedController {
    pub(crate) fn start(
        skill: &str,
        mut controller: Box<dyn Controller>,
        budget: Duration,
    ) -> std::io::Result<Self> {
        let call = Call {
            what: What::Act,
            state: StateBuffer::default(),
            command: Command::velocity(0.0, 0.0, 0.0),
            joints: Vec::new(),
            answer: Ok(()),
        };
        let process = Arc::new(Beside::default());
        let beside = Arc::clone(&process);
        controller.process().inspect(|&number| process.follow(number));
        let run = move |call: &mut Call| {
            beside.come_back();
            let state = call.state.state();
            call.answer = match call.what {
                What::ResetAndAct => controller.begin(&state, &call.command, &mut call.joints),
                What::Reset => controller.reset(&state).map_err(|fault| ("reset", fault)),
                What::Act => {
                    controller.act(&state, &call.command, &mut call.joints).map_err(|fault| ("act", fault))
                }
                What::Revive => {
                    controller.revive();
                    controller.process().inspect(|&number| beside.followed_by(number));
                    Ok(())
                }
            };
            match controller.process() {
                Some(_) => beside.come_back(),
                None => beside.is_gone(),
            }
        };
        let panicked = |call: &mut Call, words: &str| {
            call.answer = Err(("act", CallFault::Failed(format!("panicked: {words}"))));
        };
        Ok(Self { worker: Worker::start(format!("act {skill}"), call, run, panicked)?, process, budget })
    }

    /// What a call answers within the budget.
    fn ask(
        &mut self,
        what: What,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), (&'static str, CallFault)> {
        let (count, budget) = (joints.len(), self.budget);
        let fill = |call: &mut Call| {
            call.what = what;
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
            self.process.give_way();
            let call = match what {
                What::ResetAndAct => "reset and act",
                What::Reset => "reset",
                What::Act | What::Revive => "act",
            };
            Err((call, CallFault::Overrun(budget)))
        })
    }
}

impl Controller for WatchedController {
    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), CallFault> {
        let standing = Command::velocity(0.0, 0.0, 0.0);
        self.ask(What::Reset, state, &standing, &mut []).map_err(|(_, fault)| fault)
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), CallFault> {
        self.ask(What::Act, state, command, joints).map_err(|(_, fault)| fault)
    }

    fn begin(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), (&'static str, CallFault)> {
        self.ask(What::ResetAndAct, state, command, joints)
    }

    fn revive(&mut self) {
        // One that hangs still is not revived: its thread is not free.
        let _ = self.worker.ask(REVIVAL, |call| call.what = What::Revive, |_| ());
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
