//! One controller of a plugin, with the promises of the interface checked on the host's side.

use std::fmt;
use std::sync::Arc;

use abi_stable::std_types::RSliceMut;
use vocaloco_plugin_api::abi::BoxedInstance;
use vocaloco_plugin_api::{Command, ErrorCode, JointTarget, Needs, RobotDescription, RobotState, SkillError};

use super::PluginLibrary;
#[cfg(target_os = "linux")]
use super::isolation::ChildInstance;

/// An instance; used by one thread at a time.
///
/// It promises the plugin arrays of the declared lengths and the caller that a panic is an error.
/// Whether targets are finite and within the drives' limits is the runtime's to check, which knows
/// what to do instead.
pub struct PluginInstance {
    instance: Instance,
    library: Arc<PluginLibrary>,
    needs: Needs,
    joints: usize,
    feet: usize,
    terrain_points: usize,
}

/// Where the plugin's code runs.
pub(super) enum Instance {
    /// In this process.
    Here(BoxedInstance),
    /// In one of its own.
    #[cfg(target_os = "linux")]
    Child(Box<ChildInstance>),
}

impl PluginInstance {
    pub(super) fn new(
        library: Arc<PluginLibrary>,
        instance: Instance,
        needs: Needs,
        robot: &RobotDescription,
    ) -> Self {
        Self {
            instance,
            joints: robot.joints.len(),
            feet: if needs.foot_contacts { robot.feet.len() } else { 0 },
            terrain_points: needs.terrain.as_ref().map_or(0, |patch| patch.rows() * patch.columns()),
            needs,
            library,
        }
    }

    /// The plugin it belongs to.
    pub fn library(&self) -> &Arc<PluginLibrary> {
        &self.library
    }

    /// What it reads each tick.
    pub fn needs(&self) -> &Needs {
        &self.needs
    }

    /// The process that it runs in, where that is another one.
    pub fn process(&self) -> Option<u32> {
        match &self.instance {
            Instance::Here(_) => None,
            #[cfg(target_os = "linux")]
            Instance::Child(child) => child.id(),
        }
    }

    /// Makes an instance whose process has ended anew, in another one; elsewhere there is nothing to do.
    pub fn revive(&mut self) {
        match &mut self.instance {
            Instance::Here(_) => {}
            #[cfg(target_os = "linux")]
            Instance::Child(child) => child.revive(),
        }
    }

    /// Forget everything: called when the skill becomes active.
    ///
    /// # Errors
    /// `state` lacks what the plugin needs, or the plugin reports a failure.
    pub fn reset(&mut self, state: &RobotState<'_>) -> Result<(), SkillError> {
        self.check(state)?;
        match &mut self.instance {
            Instance::Here(instance) => instance.reset(state).into_result(),
            #[cfg(target_os = "linux")]
            Instance::Child(child) => child.reset(state),
        }
    }

    /// One tick: fills `joints`, one target a joint, in the robot's order.
    ///
    /// # Errors
    /// `state` lacks what the plugin needs, `joints` has another length than the robot, or the plugin
    /// reports a failure; `joints` then holds nothing to be relied on.
    pub fn act(
        &mut self,
        state: &RobotState<'_>,
        command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        self.check(state)?;
        self.length("joint targets", joints.len(), self.joints)?;
        match &mut self.instance {
            Instance::Here(instance) => {
                instance.act(state, command, RSliceMut::from_mut_slice(joints)).into_result()
            }
            #[cfg(target_os = "linux")]
            Instance::Child(child) => child.act(state, command, joints),
        }
    }

    fn check(&self, state: &RobotState<'_>) -> Result<(), SkillError> {
        self.length("joint_position_rad", state.joint_position_rad.len(), self.joints)?;
        self.length("joint_velocity_rad_per_s", state.joint_velocity_rad_per_s.len(), self.joints)?;
        if self.needs.joint_torques {
            self.length("joint_torque_nm", state.joint_torque_nm.len(), self.joints)?;
        }
        if self.feet > 0 {
            self.length("foot_contact", state.foot_contact.len(), self.feet)?;
        }
        if self.terrain_points > 0 {
            self.length("terrain_m", state.terrain_m.len(), self.terrain_points)?;
        }
        Ok(())
    }

    fn length(&self, field: &str, found: usize, wanted: usize) -> Result<(), SkillError> {
        if found == wanted {
            return Ok(());
        }
        let plugin = &self.library.description().name;
        let message = format!("{plugin}: {field}: found {found} values, wanted {wanted}");
        Err(SkillError::new(ErrorCode::Input, message))
    }
}

impl fmt::Debug for PluginInstance {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "PluginInstance({})", self.library.description().name)
    }
}
