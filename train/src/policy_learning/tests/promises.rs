use vocaloco_sim::threads::with_threads;

use super::super::checkpoint::{Run, decode, encode};
use super::super::config::{ImitationConfig, Plan};
use super::super::learner::Learner;
use super::super::single_pass::Scratch;
use super::super::task::Task;
use super::super::trainer::{Trainer, make_tasks, widths};
use super::point_mass::{EPISODE_STEPS, PointMass};

fn plan() -> Plan {
    let mut plan = Plan::with_environment(32, ());
    plan.network.actor = vec![32, 32];
    plan.network.critic = vec![32, 32];
    plan.network.initial_std = 0.6;
    plan.segment_iterations = 3;
    plan.ppo.iterations = 60;
    plan.ppo.entropy = 0.001;
    plan
}

fn trainer(plan: &Plan, seed: u64, learner: Option<Learner>) -> Trainer<PointMass> {
    let tasks = make_tasks(plan, |number| Ok(PointMass::new(seed, number))).unwrap();
    let learner = learner.unwrap_or_else(|| Learner::new(plan, widths(&tasks[0]), seed));
    Trainer::new(plan.clone(), seed, tasks, learner)
}

/// Mean distance from the origin at the end of fresh episodes driven by the policy's mean.
fn final_distance(learner: &Learner) -> f32 {
    let policy = learner.single_pass();
    let mut scratch = Scratch::default();
    let mut sum = 0.0;
    for number in 0..50 {
        let mut task = PointMass::new(99, number * EPISODE_STEPS);
        task.restart(0, 0);
        let (mut observation, mut privileged) = ([0.0; 4], [0.0; 5]);
        for _ in 0..EPISODE_STEPS {
            task.observe(&mut observation, &mut privileged);
            let action = policy.answer(&observation, &mut scratch).to_vec();
            task.step(&action);
        }
        task.observe(&mut observation, &mut privileged);
        sum += (observation[0] * observation[0] + observation[1] * observation[1]).sqrt() / 50.0;
    }
    sum
}

#[test]
fn ppo_brings_a_mass_to_the_origin() {
    let plan = plan();
    let mut trainer = trainer(&plan, 1, None);
    let before = final_distance(&trainer.learner);
    while !trainer.is_done() {
        trainer.segment(|_| Ok(())).unwrap();
    }
    let after = final_distance(&trainer.learner);
    assert!(before > 0.8, "too easy: {before} m without learning");
    assert!(after < 0.15, "{after} m from the origin after learning, {before} m before");
}

#[test]
fn imitation_follows_an_expert_from_states_of_its_own() {
    let mut plan = plan();
    plan.imitation = Some(ImitationConfig {
        rounds: 6,
        steps: 40,
        stint_steps: 10,
        batch: 128,
        epochs: 10,
        ..ImitationConfig::default()
    });
    let mut trainer = trainer(&plan, 2, None);
    let mut losses = Vec::new();
    trainer
        .imitate(|record| {
            losses.push(record.fit.fresh_loss);
            Ok(())
        })
        .unwrap();
    assert!(losses[5] < 0.1 * losses[0], "{losses:?}");
    let distance = final_distance(&trainer.learner);
    assert!(distance < 0.15, "{distance} m from the origin");
    assert!(!trainer.imitates());
}

fn bytes_after(plan: &Plan, threads: usize, segments: usize) -> Vec<u8> {
    let run = Run { seed: 3, config: String::new() };
    with_threads(threads, || {
        let mut trainer = trainer(plan, 3, None);
        trainer.imitate(|_| Ok(())).unwrap();
        for _ in 0..segments {
            trainer.segment(|_| Ok(())).unwrap();
        }
        encode(&trainer.learner, &run)
    })
    .unwrap()
}

fn small_plan() -> Plan {
    let mut plan = plan();
    plan.imitation = Some(ImitationConfig {
        rounds: 2,
        steps: 30,
        capacity: 1500,
        epochs: 1,
        ..ImitationConfig::default()
    });
    plan.ppo.imitation = 0.1;
    plan.ppo.critic_iterations = 2;
    plan
}

#[test]
fn a_checkpoint_resumed_equals_a_run_never_stopped() {
    let plan = small_plan();
    let straight = bytes_after(&plan, 2, 4);
    let half = bytes_after(&plan, 2, 2);
    let (learner, run) = decode(&half, &plan, widths(&PointMass::new(0, 0))).unwrap();
    assert!(learner.levels.iter().any(|level| *level > 0), "no level to keep: {:?}", learner.levels);
    let mut resumed = trainer(&plan, run.seed, Some(learner));
    assert!(!resumed.imitates());
    for _ in 0..2 {
        resumed.segment(|_| Ok(())).unwrap();
    }
    assert!(encode(&resumed.learner, &run) == straight, "the resumed run differs");
    assert!(straight != half);
}

#[test]
fn the_same_bytes_on_one_thread_and_on_two() {
    let plan = small_plan();
    assert!(bytes_after(&plan, 1, 2) == bytes_after(&plan, 2, 2), "threads change the result");
}

#[test]
fn another_seed_learns_something_else() {
    let plan = plan();
    let after = |seed| {
        let mut trainer = trainer(&plan, seed, None);
        trainer.segment(|_| Ok(())).unwrap();
        trainer.learner.policy
    };
    assert_ne!(after(1), after(2));
}

#[test]
fn an_environment_without_an_expert_cannot_be_imitated() {
    struct Alone(PointMass);
    impl Task for Alone {
        fn observation_len(&self) -> usize {
            self.0.observation_len()
        }
        fn privileged_len(&self) -> usize {
            self.0.privileged_len()
        }
        fn action_len(&self) -> usize {
            self.0.action_len()
        }
        fn restart(&mut self, segment: u64, level: u32) {
            self.0.restart(segment, level);
        }
        fn begin_episode(&mut self) {
            self.0.begin_episode();
        }
        fn observe(&self, observation: &mut [f32], privileged: &mut [f32]) {
            self.0.observe(observation, privileged);
        }
        fn step(&mut self, action: &[f32]) -> super::super::task::Step {
            self.0.step(action)
        }
        fn expert_action(&mut self, _: &mut [f32]) -> bool {
            false
        }
        fn reward_terms(&self) -> &[(&'static str, f32)] {
            self.0.reward_terms()
        }
        fn level(&self) -> u32 {
            self.0.level()
        }
    }
    let plan = small_plan();
    let tasks = make_tasks(&plan, |number| Ok(Alone(PointMass::new(1, number)))).unwrap();
    let learner = Learner::new(&plan, widths(&tasks[0]), 1);
    let error = Trainer::new(plan, 1, tasks, learner).imitate(|_| Ok(())).unwrap_err().to_string();
    assert!(error.contains("without an expert"), "{error}");
}
