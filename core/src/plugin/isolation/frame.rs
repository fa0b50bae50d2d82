//! A call and its answer as bytes, little-endian; every array with its length before it.

use vocaloco_plugin_api::{Command, CommandKind, ErrorCode, JointTarget, RobotState, SkillError};

use crate::plugin::StateBuffer;

/// The number of a call, which its answer repeats: an answer to another call is none.
pub(super) type CallNumber = [u8; 8];

/// Before the first call.
pub(super) const NO_CALL: CallNumber = [0; 8];

/// What the child is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Call {
    Reset,
    Act,
}

/// A call as the child holds it, its arrays reused from call to call.
#[derive(Debug)]
pub(super) struct CallBuffer {
    pub(super) call: Call,
    pub(super) state: StateBuffer,
    pub(super) command: Command,
    pub(super) joints: Vec<JointTarget>,
}

impl Default for CallBuffer {
    fn default() -> Self {
        Self {
            call: Call::Reset,
            state: StateBuffer::default(),
            command: Command::velocity(0.0, 0.0, 0.0),
            joints: Vec::new(),
        }
    }
}

/// Writes a call; `joints` is what the targets hold before it.
pub(super) fn write_call(
    bytes: &mut Vec<u8>,
    call: Call,
    state: &RobotState<'_>,
    command: &Command,
    joints: &[JointTarget],
) {
    bytes.clear();
    bytes.push(u8::from(call == Call::Act));
    bytes.push(u8::from(command.kind == CommandKind::PositionTarget));
    bytes.extend(state.time_s.to_le_bytes());
    put(bytes, &command.velocity);
    put(bytes, &command.target);
    put(bytes, &state.base_linear_velocity_m_per_s);
    put(bytes, &state.base_angular_velocity_rad_per_s);
    put(bytes, &state.projected_gravity);
    put(bytes, &state.joint_position_rad);
    put(bytes, &state.joint_velocity_rad_per_s);
    put(bytes, &state.joint_torque_nm);
    put(bytes, &state.terrain_m);
    bytes.extend((state.foot_contact.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&state.foot_contact);
    put_joints(bytes, joints);
}

/// Reads a call; none when the bytes are not one.
pub(super) fn read_call(bytes: &[u8], into: &mut CallBuffer) -> Option<()> {
    let mut from = Reader(bytes);
    let state = &mut into.state;
    into.call = if from.byte()? == 1 { Call::Act } else { Call::Reset };
    into.command.kind = if from.byte()? == 1 { CommandKind::PositionTarget } else { CommandKind::Velocity };
    state.time_s = f64::from_le_bytes(*from.take(8)?.as_array()?);
    from.array(&mut into.command.velocity)?;
    from.array(&mut into.command.target)?;
    from.array(&mut state.base_linear_velocity_m_per_s)?;
    from.array(&mut state.base_angular_velocity_rad_per_s)?;
    from.array(&mut state.projected_gravity)?;
    from.values(&mut state.joint_position_rad)?;
    from.values(&mut state.joint_velocity_rad_per_s)?;
    from.values(&mut state.joint_torque_nm)?;
    from.values(&mut state.terrain_m)?;
    let contacts = from.length()?;
    state.foot_contact.clear();
    state.foot_contact.extend_from_slice(from.take(contacts)?);
    from.joints(&mut into.joints)
}

/// Writes an answer.
pub(super) fn write_answer(bytes: &mut Vec<u8>, answer: &Result<(), SkillError>, joints: &[JointTarget]) {
    bytes.clear();
    match answer {
        Ok(()) => {
            bytes.push(0);
            put_joints(bytes, joints);
        }
        Err(error) => {
            bytes.push(match error.code {
                ErrorCode::Parameters => 1,
                ErrorCode::Robot => 2,
                ErrorCode::Input => 3,
                ErrorCode::Panic => 4,
                ErrorCode::Internal => 5,
            });
            let message = error.message.as_bytes();
            bytes.extend_from_slice(&message[..message.len().min(MAX_MESSAGE_BYTES)]);
        }
    }
}

/// Longest message of an error that is passed on, bytes.
const MAX_MESSAGE_BYTES: usize = 1000;

/// Reads an answer into `joints`.
pub(super) fn read_answer(bytes: &[u8], joints: &mut [JointTarget]) -> Result<(), SkillError> {
    let nonsense = || SkillError::new(ErrorCode::Internal, "found an answer that is none");
    let mut from = Reader(bytes);
    let code = match from.byte().ok_or_else(nonsense)? {
        0 => {
            let count = from.length().ok_or_else(nonsense)?;
            if count != joints.len() {
                let message = format!("found {count} joint targets, wanted {}", joints.len());
                return Err(SkillError::new(ErrorCode::Internal, message));
            }
            for joint in joints {
                *joint = from.joint().ok_or_else(nonsense)?;
            }
            return Ok(());
        }
        1 => ErrorCode::Parameters,
        2 => ErrorCode::Robot,
        3 => ErrorCode::Input,
        4 => ErrorCode::Panic,
        _ => ErrorCode::Internal,
    };
    let message = &from.0[..from.0.len().min(MAX_MESSAGE_BYTES)];
    Err(SkillError::new(code, String::from_utf8_lossy(message).into_owned()))
}

fn put(bytes: &mut Vec<u8>, values: &[f32]) {
    bytes.extend((values.len() as u32).to_le_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

fn put_joints(bytes: &mut Vec<u8>, joints: &[JointTarget]) {
    bytes.extend((joints.len() as u32).to_le_bytes());
    for joint in joints {
        let values = [
            joint.position_rad,
            joint.stiffness_nm_per_rad,
            joint.damping_nms_per_rad,
            joint.feed_forward_nm,
        ];
        bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn byte(&mut self) -> Option<u8> {
        self.take(1).map(|taken| taken[0])
    }

    fn length(&mut self) -> Option<usize> {
        Some(u32::from_le_bytes(*self.take(4)?.as_array()?) as usize)
    }

    fn value(&mut self) -> Option<f32> {
        Some(f32::from_le_bytes(*self.take(4)?.as_array()?))
    }

    fn array(&mut self, into: &mut [f32]) -> Option<()> {
        (self.length()? == into.len()).then_some(())?;
        into.iter_mut().try_for_each(|value| self.value().map(|read| *value = read))
    }

    fn values(&mut self, into: &mut Vec<f32>) -> Option<()> {
        let count = self.length()?;
        let (values, _) = self.take(count.checked_mul(4)?)?.as_chunks::<4>();
        into.clear();
        into.extend(values.iter().map(|bytes| f32::from_le_bytes(*bytes)));
        Some(())
    }

    fn joint(&mut self) -> Option<JointTarget> {
        Some(JointTarget {
            position_rad: self.value()?,
            stiffness_nm_per_rad: self.value()?,
            damping_nms_per_rad: self.value()?,
            feed_forward_nm: self.value()?,
        })
    }

    fn joints(&mut self, into: &mut Vec<JointTarget>) -> Option<()> {
        let count = self.length()?;
        into.clear();
        for _ in 0..count {
            into.push(self.joint()?);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn buffer() -> CallBuffer {
        CallBuffer {
            call: Call::Act,
            state: StateBuffer {
                time_s: 1.25,
                joint_position_rad: vec![0.1, f32::NAN, -3.0],
                joint_velocity_rad_per_s: vec![4.0, 5.0, 6.0],
                joint_torque_nm: vec![],
                base_linear_velocity_m_per_s: [0.1, 0.2, 0.3],
                base_angular_velocity_rad_per_s: [0.4, 0.5, 0.6],
                projected_gravity: [0.0, 0.1, -0.9],
                foot_contact: vec![1, 0],
                terrain_m: vec![0.5; 77],
            },
            command: Command {
                kind: CommandKind::PositionTarget,
                velocity: [1.0, 2.0, 3.0],
                target: [4.0, 5.0, 6.0, 7.0],
            },
            joints: vec![JointTarget { position_rad: 0.3, ..JointTarget::default() }; 3],
        }
    }

    fn written() -> Vec<u8> {
        let (mut bytes, it) = (Vec::new(), buffer());
        write_call(&mut bytes, it.call, &it.state.state(), &it.command, &it.joints);
        bytes
    }

    #[test]
    fn a_call_is_read_as_it_was_written_bit_for_bit() {
        let mut read = CallBuffer::default();
        read_call(&written(), &mut read).unwrap();
        assert_eq!(format!("{read:?}"), format!("{:?}", buffer()));
    }

    #[test]
    fn a_call_cut_short_anywhere_is_none() {
        let whole = written();
        for length in 0..whole.len() {
            assert!(read_call(&whole[..length], &mut CallBuffer::default()).is_none(), "{length} bytes");
        }
    }

    #[test]
    fn an_answer_of_another_length_or_of_nonsense_is_an_error() {
        let mut bytes = Vec::new();
        let mut joints = vec![JointTarget::default(); 3];
        let answer = buffer().joints;
        write_answer(&mut bytes, &Ok(()), &answer);
        read_answer(&bytes, &mut joints).unwrap();
        assert_eq!(joints, answer);
        let error = read_answer(&bytes, &mut joints[..2]).unwrap_err();
        assert_eq!(error.message, "found 3 joint targets, wanted 2");
        for length in 0..bytes.len() {
            assert!(read_answer(&bytes[..length], &mut joints).is_err(), "{length} bytes");
        }
        write_answer(&mut bytes, &Err(SkillError::new(ErrorCode::Panic, "out of cheese")), &[]);
        let error = read_answer(&bytes, &mut joints).unwrap_err();
        assert_eq!((error.code, error.message.as_str()), (ErrorCode::Panic, "out of cheese"));
        let long = SkillError::new(ErrorCode::Panic, "left != right ".repeat(1 << 18));
        write_answer(&mut bytes, &Err(long), &[]);
        let error = read_answer(&bytes, &mut joints).unwrap_err();
        assert_eq!((error.code, error.message.len()), (ErrorCode::Panic, MAX_MESSAGE_BYTES));
    }
}
