//! A plugin that holds the stand and misbehaves as its parameter text says: `fault after_ticks`, such
//! as `panic 10`, and a seed for those that come by chance; see `Fault`. It uses the interface crate alone, as a plugin may.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use vocaloco_plugin_api::abi::abi_stable::std_types::{RNone, RVec};
use vocaloco_plugin_api::{
    Command, CommandKind, Description, ErrorCode, Host, JointTarget, Needs, Range, RobotDescription,
    RobotState, Skill, SkillError,
};

/// How it misbehaves in `act`, from the tick `after_ticks` on.
#[derive(Clone, Copy, Debug)]
enum Fault {
    None,
    Panic,
    PanicInReset,
    LongError,
    SecondAnswer,
    Error,
    /// Starts a process that outlives it, and reports an error that holds its number.
    Process,
    Nan,
    InfiniteGain,
    OutOfRange,
    NegativeStiffness,
    /// Asks for no gains at all.
    Limp,
    /// Prints a line to stdout and takes one from stdin.
    Prints,
    /// Leaves the targets as they were handed in.
    Silent,
    /// Sleeps 1.5 s.
    Slow,
    /// Says 1e9 rad.
    Billion,
    /// Fills in the first seven targets only.
    Short,
    /// Fills in one target more than there are joints.
    Long,
    /// Never returns, asleep.
    Hang,
    /// Never returns, busy.
    Spin,
    /// Keeps 32 MiB more each tick.
    Leak,
    /// Answers the same input otherwise each time.
    Drift,
    /// Writes where it must not.
    Segfault,
    /// Ends its process.
    Abort,
    /// In one tick of 32, at times that follow from a seed, any fault that the host's process survives.
    Wild(u64),
    /// The same with any fault that a process of its own is for.
    Fragile(u64),
}

/// What `Wild` comes to.
const WILD: [Fault; 10] = [
    Fault::Panic,
    Fault::Error,
    Fault::Nan,
    Fault::InfiniteGain,
    Fault::OutOfRange,
    Fault::NegativeStiffness,
    Fault::Silent,
    Fault::Billion,
    Fault::Short,
    Fault::Long,
];
/// What `Fragile` comes to; a hang costs seconds of the clock, so it is rare.
const FRAGILE: [Fault; 8] = [
    Fault::Segfault,
    Fault::Abort,
    Fault::Leak,
    Fault::Segfault,
    Fault::Abort,
    Fault::Leak,
    Fault::Segfault,
    Fault::Hang,
];

impl Fault {
    /// What it comes to at a time: one that comes by chance stays as it is, or becomes another for good.
    fn at(self, time_s: f64) -> Self {
        let (seed, kinds) = match self {
            Self::Wild(seed) => (seed, &WILD[..]),
            Self::Fragile(seed) => (seed, &FRAGILE[..]),
            other => return other,
        };
        // splitmix64.
        let mut mixed = (time_s.to_bits() ^ seed).wrapping_add(0x9e37_79b9_7f4a_7c15);
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^= mixed >> 31;
        if mixed.is_multiple_of(32) { kinds[(mixed >> 32) as usize % kinds.len()] } else { self }
    }
}

/// The controller.
pub struct Faulty {
    fault: Fault,
    after_ticks: u32,
    tick: u32,
    stand_rad: Vec<f32>,
}

fn refuse(found: &str) -> SkillError {
    SkillError::new(
        ErrorCode::Parameters,
        format!("parameters: found {found:?}, wanted a fault and a tick, such as `panic 10`"),
    )
}

impl Skill for Faulty {
    fn describe() -> Description {
        Description {
            name: "faulty".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            summary: "Misbehaves as told".into(),
            joints: RVec::new(),
            rate_hz: 50.0,
            command: CommandKind::Velocity,
            forward_m_per_s: Range { min: -1.0, max: 1.0 },
            needs: Needs { policy: false, terrain: RNone, foot_contacts: false, joint_torques: false },
            parameters: RVec::new(),
        }
    }

    fn create(parameters: &str, robot: &RobotDescription, _host: Host) -> Result<Self, SkillError> {
        let mut words = parameters.split_whitespace();
        let fault = match words.next() {
            None | Some("none") => Fault::None,
            Some("panic") => Fault::Panic,
            Some("panic_in_reset") => Fault::PanicInReset,
            Some("panic_in_create") => panic!("asked for a panic in create"),
            Some("long_error") => Fault::LongError,
            Some("second_answer") => Fault::SecondAnswer,
            Some("error") => Fault::Error,
            Some("process") => Fault::Process,
            Some("nan") => Fault::Nan,
            Some("infinite_gain") => Fault::InfiniteGain,
            Some("out_of_range") => Fault::OutOfRange,
            Some("negative_stiffness") => Fault::NegativeStiffness,
            Some("limp") => Fault::Limp,
            Some("prints") => Fault::Prints,
            Some("silent") => Fault::Silent,
            Some("slow") => Fault::Slow,
            Some("billion") => Fault::Billion,
            Some("short") => Fault::Short,
            Some("long") => Fault::Long,
            Some("hang") => Fault::Hang,
            Some("spin") => Fault::Spin,
            Some("leak") => Fault::Leak,
            Some("drift") => Fault::Drift,
            Some("segfault") => Fault::Segfault,
            Some("abort") => Fault::Abort,
            Some("abort_in_create") => std::process::abort(),
            Some("hang_in_create") => loop {
                std::thread::sleep(Duration::from_millis(1));
            },
            Some("wild") => Fault::Wild(0),
            Some("fragile") => Fault::Fragile(0),
            Some(other) => return Err(refuse(other)),
        };
        let after_ticks = match words.next() {
            None => 0,
            Some(number) => number.parse().map_err(|_| refuse(number))?,
        };
        let seed = match words.next() {
            None => 0,
            Some(number) => number.parse().map_err(|_| refuse(number))?,
        };
        let fault = match fault {
            Fault::Wild(_) => {
                // Hundreds of panics that nobody waits for are not worth a line each.
                std::panic::set_hook(Box::new(|_| {}));
                Fault::Wild(seed)
            }
            Fault::Fragile(_) => Fault::Fragile(seed),
            fault => fault,
        };
        let stand_rad = robot.joints.iter().map(|joint| joint.stand_rad as f32).collect();
        Ok(Self { fault, after_ticks, tick: 0, stand_rad })
    }

    fn reset(&mut self, _state: &RobotState<'_>) -> Result<(), SkillError> {
        assert!(!matches!(self.fault, Fault::PanicInReset), "asked for a panic in reset");
        self.tick = 0;
        Ok(())
    }

    fn act(
        &mut self,
        state: &RobotState<'_>,
        _command: &Command,
        joints: &mut [JointTarget],
    ) -> Result<(), SkillError> {
        let due = self.tick >= self.after_ticks;
        if due {
            self.fault = self.fault.at(state.time_s);
        }
        self.tick += 1;
        if due && matches!(self.fault, Fault::Silent) {
            return Ok(());
        }
        let count = if due && matches!(self.fault, Fault::Short) { 7 } else { joints.len() };
        for (target, position_rad) in joints[..count].iter_mut().zip(&self.stand_rad) {
            *target = JointTarget {
                position_rad: *position_rad,
                stiffness_nm_per_rad: 80.0,
                damping_nms_per_rad: 2.0,
                feed_forward_nm: 0.0,
            };
        }
        if due {
            // Not the first joint, so that a check of only that one is caught.
            let joint = &mut joints[7];
            match self.fault {
                Fault::None
                | Fault::PanicInReset
                | Fault::Silent
                | Fault::Short
                | Fault::Wild(_)
                | Fault::Fragile(_) => {}
                Fault::Panic => panic!("asked for a panic in act"),
                // More than the memory between host and child holds.
                Fault::LongError => {
                    return Err(SkillError::new(ErrorCode::Internal, "words ".repeat(1 << 19)));
                }
                Fault::SecondAnswer => answer_the_host(),
                Fault::Error => return Err(SkillError::new(ErrorCode::Internal, "asked for an error")),
                Fault::Process => {
                    let words = format!("asked for a process, which is {}", start_a_process());
                    return Err(SkillError::new(ErrorCode::Internal, words));
                }
                Fault::Nan => joint.position_rad = f32::NAN,
                Fault::InfiniteGain => joint.damping_nms_per_rad = f32::INFINITY,
                Fault::OutOfRange => joint.position_rad = 50.0,
                Fault::NegativeStiffness => joint.stiffness_nm_per_rad = -80.0,
                Fault::Limp => {
                    for joint in joints {
                        (joint.stiffness_nm_per_rad, joint.damping_nms_per_rad) = (0.0, 0.0);
                    }
                }
                #[allow(clippy::print_stdout, reason = "that it does is its fault")]
                Fault::Prints => {
                    println!("where do my words end up?");
                    drop(std::io::stdin().read_line(&mut String::new()));
                }
                Fault::Slow => std::thread::sleep(Duration::from_millis(1500)),
                Fault::Billion => joint.position_rad = 1e9,
                Fault::Long => joints[self.stand_rad.len()] = JointTarget::default(),
                Fault::Hang => loop {
                    std::thread::sleep(Duration::from_millis(1));
                },
                Fault::Spin => loop {
                    std::hint::spin_loop();
                },
                Fault::Leak => std::mem::forget(std::hint::black_box(vec![1_u8; 32 << 20])),
                Fault::Drift => joint.position_rad += 1e-3 * CALLS.fetch_add(1, Ordering::Relaxed) as f32,
                Fault::Segfault => write_nowhere(),
                Fault::Abort => std::process::abort(),
            }
        }
        Ok(())
    }
}

/// Calls of all instances that drift: what no reset forgets.
static CALLS: AtomicU32 = AtomicU32::new(0);

/// Writes to the sockets that its process has: of an isolated plugin's one is the host's.
#[allow(unsafe_code, reason = "a descriptor of another's is no file to write to otherwise")]
fn answer_the_host() {
    use std::io::Write;
    use std::os::fd::FromRawFd;
    let is_socket = |descriptor: &i32| {
        let link = std::fs::read_link(format!("/proc/self/fd/{descriptor}"));
        link.is_ok_and(|link| link.to_string_lossy().starts_with("socket:"))
    };
    // Not the standard streams, one of which may lead to a journal.
    for descriptor in (3..64).filter(is_socket) {
        // SAFETY: the descriptor is open, and is not closed here.
        let mut host = std::mem::ManuallyDrop::new(unsafe { std::fs::File::from_raw_fd(descriptor) });
        drop(host.write_all(&1_u64.to_le_bytes()));
    }
}

/// Number of a process that would still be there in a minute; 0 if there is none.
fn start_a_process() -> u32 {
    use std::process::{Command as Process, Stdio};
    let started = Process::new("sleep").arg("60").stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    started.map_or(0, |child| child.id())
}

#[allow(unsafe_code, reason = "a fault that only a process of its own survives")]
fn write_nowhere() {
    let nowhere = std::hint::black_box(8_usize) as *mut u32;
    // SAFETY: none: the first page is never mapped, and the process ends here.
    unsafe { nowhere.write_volatile(1) };
}

vocaloco_plugin_api::export_skill!(Faulty);
