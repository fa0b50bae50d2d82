//! The trait that a plugin's author implements.

use crate::{Command, Description, Host, JointTarget, Needs, RobotDescription, RobotState, SkillError};

/// A locomotion controller. Instances are independent; hundreds may live side by side.
///
/// Between two calls of [`reset`](Self::reset), the same sequence of inputs must give the same
/// bytes: no randomness, no clock. `act` must not allocate.
pub trait Skill: Send + Sized + 'static {
    /// What the plugin is, what it needs and what can be tuned.
    fn describe() -> Description;

    /// A new instance for `robot`, from the text that the manifest's parameter file holds, or its
    /// `[contract]` where it has one beside a policy network.
    ///
    /// # Errors
    /// When the text names something the plugin does not know or a value outside its range, or the
    /// robot lacks what the plugin needs.
    fn create(parameters: &str, robot: &RobotDescription, host: Host) -> Result<Self, SkillError>;

    /// What this instance reads each tick: what the description says, unless parameters change it.
    fn needs(&self) -> Needs {
        Self::describe().needs
    }

    /// Forget everything: called when the skill becomes active.
    fn reset(&mut self, state: &RobotState<'_>) -> Result<(), SkillError>;

    /// One tick: fill `joints`, one target a joint, in the robot's order.
    fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError>;
}
