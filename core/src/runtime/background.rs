//! Work beside the loop that gives way to it.

use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::sync::atomic::{AtomicBool, AtomicI32};

/// Lets the calling thread, and what it starts from now on, give way to a loop that runs at a real-time priority.
///
/// Threads inherit the policy by which they are scheduled: loading a skill would take the only core of a loop that
/// is held to it for as long as it lasts. The thread goes back to the system's normal policy; where that is
/// refused, it goes on as it was. Other systems than Linux do nothing here.
#[cfg_attr(target_os = "linux", allow(unsafe_code, reason = "the scheduler is reached through C alone"))]
pub fn give_way() {
    #[cfg(target_os = "linux")]
    // SAFETY: the call is about the calling thread, which 0 stands for, and reads `parameters`, a plain struct of
    // integers for which all zeros is the normal policy's only value.
    unsafe {
        let parameters: libc::sched_param = std::mem::zeroed();
        libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const parameters);
    }
}

/// A thread or process that computes for the loop, one real-time priority below it, so that one that spins never keeps
/// the loop from a core; from when it is found late until it has ended it gives way to all others that do.
///
/// Without a real-time policy all of it stays as it was, as on other systems than Linux and where the system refuses; at
/// the lowest priority of one, what computes has the loop's own.
#[derive(Debug, Default)]
pub(super) struct Beside {
    /// Its number; 0 is none.
    number: AtomicI32,
    policy: AtomicI32,
    priority: AtomicI32,
    gave_way: AtomicBool,
}

#[cfg_attr(target_os = "linux", allow(unsafe_code, reason = "the scheduler is reached through C alone"))]
impl Beside {
    /// The thread or process of this number from now on, one priority below the calling thread's.
    pub(super) fn follow(&self, number: u32) {
        #[cfg(target_os = "linux")]
        // SAFETY: the calls are about the calling thread, which 0 stands for, and write to `parameters`, a plain struct
        // of integers that lives here.
        unsafe {
            let mut parameters: libc::sched_param = std::mem::zeroed();
            let policy = libc::sched_getscheduler(0);
            if policy < 0 || libc::sched_getparam(0, &raw mut parameters) != 0 {
                return;
            }
            self.policy.store(policy, Relaxed);
            self.priority.store(below(parameters.sched_priority), Relaxed);
            self.followed_by(number);
        }
        #[cfg(not(target_os = "linux"))]
        let _ = number;
    }

    /// The thread or process of this number in the place of the one before it, at the same priority.
    pub(super) fn followed_by(&self, number: u32) {
        let Ok(number) = i32::try_from(number) else { return };
        self.gave_way.store(false, SeqCst);
        self.number.store(number, SeqCst);
        self.as_computing();
    }

    /// As [`follow`](Self::follow), of the calling thread, one priority below its own.
    pub(super) fn follow_here(&self) {
        #[cfg(target_os = "linux")]
        // SAFETY: asks for the number of the calling thread, nothing else.
        self.follow(unsafe { libc::gettid() }.unsigned_abs());
    }

    /// Nothing of that number is there any more, or something else is.
    pub(super) fn is_gone(&self) {
        self.number.store(0, SeqCst);
    }

    /// What it does is late: it goes on at the system's normal policy. For one thread alone, which never waits here.
    pub(super) fn give_way(&self) {
        #[cfg(target_os = "linux")]
        if [libc::SCHED_FIFO, libc::SCHED_RR].contains(&self.policy.load(Relaxed)) {
            self.gave_way.store(true, SeqCst);
            self.schedule(libc::SCHED_OTHER, 0);
            if !self.gave_way.load(SeqCst) {
                // It came back between the two, and must not stay away.
                self.as_computing();
            }
        }
    }

    /// What was late has ended: back to its priority. For another thread alone.
    pub(super) fn come_back(&self) {
        if self.gave_way.swap(false, SeqCst) {
            self.as_computing();
        }
    }

    fn as_computing(&self) {
        self.schedule(self.policy.load(Relaxed), self.priority.load(Relaxed));
    }

    fn schedule(&self, policy: i32, priority: i32) {
        #[cfg(target_os = "linux")]
        // SAFETY: reads `parameters`, a plain struct of integers that lives here.
        unsafe {
            let mut parameters: libc::sched_param = std::mem::zeroed();
            parameters.sched_priority = priority;
            let number = self.number.load(SeqCst);
            if number != 0 {
                libc::sched_setscheduler(number, policy, &raw const parameters);
            }
        }
        #[cfg(not(target_os = "linux"))]
        let _ = (policy, priority);
    }
}

/// The next lower real-time priority; 0 is none, and 1 the lowest.
#[cfg(target_os = "linux")]
fn below(priority: i32) -> i32 {
    if priority > 1 { priority - 1 } else { priority }
}

/// Keeps what skills that come and go leave behind from piling up: blocks of 128 KiB and more go back to the
/// system when they are freed, in this whole process, from now on.
///
/// glibc raises that size whenever such a block is freed, up to 32 MiB; the next networks then lie between what
/// stays, and the heap grows with every change of skills (docs/safety.md, Soak). Other allocators are left alone.
#[cfg_attr(target_os = "linux", allow(unsafe_code, reason = "the allocator is reached through C alone"))]
pub(super) fn return_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: `mallopt` takes two integers and may be called at any time.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 128 << 10);
    }
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;

    /// Real-time priority and policy of a thread or process: fields 40 and 41 of its stat.
    fn scheduled(of: &str) -> [i32; 2] {
        let stat = std::fs::read_to_string(format!("/proc/{of}/stat")).unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        [37, 38].map(|field| fields[field].parse().unwrap())
    }

    fn policy() -> i32 {
        scheduled("thread-self")[1]
    }

    /// Where real-time priorities are refused to this process, all of it stays as it was.
    #[test]
    #[allow(unsafe_code, reason = "the scheduler is reached through C alone")]
    fn what_follows_closely_runs_one_priority_below() {
        let outer = std::thread::spawn(|| {
            // SAFETY: as in `give_way`.
            let is_real_time = unsafe {
                let mut parameters: libc::sched_param = std::mem::zeroed();
                parameters.sched_priority = 3;
                libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) == 0
            };
            let thread = || {
                Beside::default().follow_here();
                scheduled("thread-self")
            };
            let thread = std::thread::spawn(thread).join().unwrap();
            let sleeps = || std::process::Command::new("sleep").arg("60").spawn().unwrap();
            let [child, second] = [(); 2].map(|()| sleeps());
            let (beside, of) = (Beside::default(), child.id().to_string());
            beside.follow(child.id());
            let process = scheduled(&of);
            beside.give_way();
            let late = scheduled(&of);
            beside.come_back();
            let back = scheduled(&of);
            // The process that a thread beside the loop starts in its place is no lower than it was.
            let of_second = second.id();
            let revived = std::thread::spawn(move || {
                Beside::default().follow_here();
                beside.followed_by(of_second);
                scheduled(&of_second.to_string())
            });
            let revived = revived.join().unwrap();
            for mut process in [child, second] {
                process.kill().and_then(|()| process.wait()).unwrap();
            }
            // From the lowest there is no way down but out of it.
            let again = std::thread::spawn(|| {
                Beside::default().follow_here();
                std::thread::spawn(|| {
                    Beside::default().follow_here();
                    std::thread::spawn(|| {
                        Beside::default().follow_here();
                        scheduled("thread-self")
                    })
                    .join()
                    .unwrap()
                })
                .join()
                .unwrap()
            });
            let again = again.join().unwrap();
            (is_real_time, [scheduled("thread-self"), thread, process, late, back, revived, again])
        });
        let (is_real_time, found) = outer.join().unwrap();
        let normal = [0, libc::SCHED_OTHER];
        let fifo = |priority| if is_real_time { [priority, libc::SCHED_FIFO] } else { normal };
        assert_eq!(found, [fifo(3), fifo(2), fifo(2), normal, fifo(2), fifo(2), fifo(1)]);
    }

    /// The policy for batches stands for a real-time one, which takes a privilege to set.
    #[test]
    #[allow(unsafe_code, reason = "the scheduler is reached through C alone")]
    fn the_thread_that_gives_way_is_a_normal_one_and_the_others_are_as_they_were() {
        let outer = std::thread::spawn(|| {
            // SAFETY: as in `give_way`.
            unsafe {
                let parameters: libc::sched_param = std::mem::zeroed();
                assert_eq!(libc::sched_setscheduler(0, libc::SCHED_BATCH, &raw const parameters), 0);
            }
            let inherits = std::thread::spawn(policy).join().unwrap();
            let gives_way = std::thread::spawn(|| {
                give_way();
                policy()
            });
            [policy(), inherits, gives_way.join().unwrap(), policy()]
        });
        let [batch, normal] = [libc::SCHED_BATCH, libc::SCHED_OTHER];
        assert_eq!(outer.join().unwrap(), [batch, batch, normal, batch]);
    }
}
