//! Work beside the loop that gives way to it.

/// Lets the calling thread, and what it starts from now on, give way to the loop, whatever priority that has.
///
/// Threads inherit priorities: under a real-time policy, loading a skill would take the only core of a loop that
/// is held to it for as long as it lasts. The thread goes back to the normal policy, ten steps of niceness
/// below; where the system refuses, it goes on as it was. Other systems than Linux do nothing here.
#[cfg_attr(target_os = "linux", allow(unsafe_code, reason = "the scheduler is reached through C alone"))]
pub fn give_way() {
    #[cfg(target_os = "linux")]
    // SAFETY: both calls are about the calling thread, which 0 stands for, and read nothing but numbers and
    // `parameters`, a plain struct of integers for which all zeros is the normal policy's only value.
    unsafe {
        let parameters: libc::sched_param = std::mem::zeroed();
        libc::sched_setscheduler(0, libc::SCHED_OTHER, &raw const parameters);
        libc::nice(10);
    }
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;

    /// Niceness and policy of the calling thread: fields 19 and 41 of its stat.
    fn standing() -> [i64; 2] {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
        [16, 38].map(|index| fields[index].parse().unwrap())
    }

    #[test]
    fn the_thread_that_gives_way_is_nicer_and_the_others_are_as_they_were() {
        let [nice, policy] = standing();
        let [nicer, normal] = std::thread::spawn(|| {
            give_way();
            standing()
        })
        .join()
        .unwrap();
        assert_eq!((nicer, normal), ((nice + 10).min(19), 0));
        assert_eq!(standing(), [nice, policy]);
    }
}
