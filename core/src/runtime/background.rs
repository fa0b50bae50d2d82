//! Work beside the loop that gives way to it.

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

/// Lets a thread or process of this number, 0 for the calling thread, run one real-time priority below the calling
/// thread's, so that one that spins never keeps the loop from a core.
///
/// Without a real-time policy, or at the lowest priority of one, it runs as the calling thread; where the system
/// refuses, as it was. Other systems than Linux do nothing here.
#[cfg_attr(target_os = "linux", allow(unsafe_code, reason = "the scheduler is reached through C alone"))]
pub(super) fn follow_closely(number: u32) {
    #[cfg(target_os = "linux")]
    // SAFETY: the calls are about the calling thread, which 0 stands for, and about `number`, and write to and read
    // from `parameters`, a plain struct of integers that lives here.
    unsafe {
        let mut parameters: libc::sched_param = std::mem::zeroed();
        let policy = libc::sched_getscheduler(0);
        if policy < 0 || libc::sched_getparam(0, &raw mut parameters) != 0 {
            return;
        }
        parameters.sched_priority = below(parameters.sched_priority);
        if let Ok(number) = libc::pid_t::try_from(number) {
            libc::sched_setscheduler(number, policy, &raw const parameters);
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = number;
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
                parameters.sched_priority = 2;
                libc::sched_setscheduler(0, libc::SCHED_FIFO, &raw const parameters) == 0
            };
            let thread = || {
                follow_closely(0);
                scheduled("thread-self")
            };
            let thread = std::thread::spawn(thread).join().unwrap();
            let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
            follow_closely(child.id());
            let process = scheduled(&child.id().to_string());
            child.kill().and_then(|()| child.wait()).unwrap();
            // From the lowest there is no way down but out of it.
            let again = std::thread::spawn(|| {
                follow_closely(0);
                std::thread::spawn(|| {
                    follow_closely(0);
                    scheduled("thread-self")
                })
                .join()
                .unwrap()
            });
            (is_real_time, [scheduled("thread-self"), thread, process, again.join().unwrap()])
        });
        let (is_real_time, found) = outer.join().unwrap();
        let fifo =
            |priority| if is_real_time { [priority, libc::SCHED_FIFO] } else { [0, libc::SCHED_OTHER] };
        assert_eq!(found, [fifo(2), fifo(1), fifo(1), fifo(1)]);
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
