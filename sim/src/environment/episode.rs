//! What is drawn for one episode.

use rand_chacha::ChaCha8Rng;
use vocaloco_core::target::TargetRule;

use super::config::EnvironmentConfig;
use crate::{driver::TICK_S, plant::Variation, rollout::RolloutRules, stream::uniform};

/// The draws of an episode.
#[derive(Clone, Debug)]
pub(super) struct Episode {
    pub(super) variant: u32,
    pub(super) pose: usize,
    pub(super) variation: Variation,
    pub(super) latency_ticks: u32,
    /// Velocity and steering; the other rules play no part.
    pub(super) rules: RolloutRules,
    /// How far ahead its target is and the time for it, which is the episode's; none follows the velocity.
    pub(super) target: Option<TargetRule>,
    /// Forward velocity that the base starts with, m/s.
    pub(super) start_m_per_s: f32,
    /// How far before the obstacle another skill hands over, m; none begins from the stand.
    pub(super) led_to_m: Option<f32>,
    /// Where in its cycle an expert starts, 0 to 1.
    pub(super) phase: f32,
    /// Ticks until time is up.
    pub(super) ticks: u32,
    /// Tick of the next push.
    pub(super) push_tick: u32,
    /// Goes on drawing pushes.
    rng: ChaCha8Rng,
}

/// Shortest time that a first episode may have, ticks.
const LEAST_TICKS: u32 = 25;

impl Episode {
    /// Draws an episode on an entry of the mix; the `first` of a segment has a random part of the time, so that
    /// not all environments time out together.
    pub(super) fn draw(config: &EnvironmentConfig, terrain: usize, first: bool, mut rng: ChaCha8Rng) -> Self {
        let mut within = |[low, high]: [f32; 2]| uniform(&mut rng, low, high);
        let mut choice = |count: u32| (within([0.0, count as f32]) as u32).min(count - 1);
        let (variant, pose) = (choice(config.variants), choice(config.poses) as usize);
        let [least, most] = config.latency_ticks;
        let latency_ticks = least + choice(most - least + 1);
        let variation = Variation {
            friction: within(config.variation.friction),
            base_mass_offset_kg: within(config.variation.base_mass_offset_kg),
            motor_strength: within(config.variation.motor_strength),
        };
        let (any_m_per_s, protocol) = (within(config.command.forward_m_per_s), within([0.0, 1.0]));
        let forward_m_per_s = if protocol < config.command.protocol_share {
            config.command.protocol_m_per_s
        } else {
            any_m_per_s
        };
        let (speed, moving) = (within(config.start.forward_m_per_s), within([0.0, 1.0]));
        let start_m_per_s = if moving < config.start.moving_share { speed } else { 0.0 };
        let phase = within([0.0, 1.0]);
        let way = config.target.map(|target| [within(target.distance_m), within(target.time_s)]);
        let all_s = way.map_or(config.episode_s, |[_, time_s]| time_s);
        let all = (f64::from(all_s) / TICK_S).round() as u32;
        let share = within([0.0, 1.0]);
        let ticks = if first { ((share * all as f32) as u32).clamp(LEAST_TICKS, all) } else { all };
        let led_to_m = config.terrain[terrain].led.as_ref().map(|led| within(led.to_m));
        let mut episode = Self {
            variant,
            pose,
            variation,
            latency_ticks,
            rules: RolloutRules {
                forward_m_per_s,
                steering_per_s: config.command.steering_per_s,
                ..RolloutRules::default()
            },
            target: way.map(|[distance_m, _]| TargetRule { distance_m, time_s: f64::from(ticks) * TICK_S }),
            start_m_per_s,
            led_to_m,
            phase,
            ticks,
            push_tick: 0,
            rng,
        };
        episode.wait_for_push(0, config);
        episode
    }

    /// Draws when the next push comes, counted from `tick`.
    fn wait_for_push(&mut self, tick: u32, config: &EnvironmentConfig) {
        let [least_s, most_s] = config.push.every_s;
        let wait_s = uniform(&mut self.rng, least_s, most_s);
        self.push_tick = tick + ((f64::from(wait_s) / TICK_S).round() as u32).max(1);
    }

    /// The push at `tick`, m/s in the world, if one comes.
    pub(super) fn push_at(&mut self, tick: u32, config: &EnvironmentConfig) -> Option<[f32; 3]> {
        if tick != self.push_tick {
            return None;
        }
        let [least, most] = config.push.speed_m_per_s;
        let speed = uniform(&mut self.rng, least, most);
        let direction_rad = uniform(&mut self.rng, 0.0, std::f32::consts::TAU);
        self.wait_for_push(tick, config);
        Some([speed * libm::cosf(direction_rad), speed * libm::sinf(direction_rad), 0.0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::stream;

    fn episodes(first: bool) -> Vec<Episode> {
        let config = EnvironmentConfig::default();
        (0..2000).map(|index| Episode::draw(&config, 0, first, stream(3, "episode", &[index]))).collect()
    }

    #[test]
    fn draws_stay_inside_their_ranges_and_reach_both_ends() {
        let all = episodes(false);
        let (mut least, mut most) = (f32::MAX, f32::MIN);
        for episode in &all {
            assert!((0.5..=1.25).contains(&episode.variation.friction));
            assert!((0.9..=1.1).contains(&episode.variation.motor_strength));
            assert!((0.4..=0.7).contains(&episode.rules.forward_m_per_s));
            assert!(episode.variant < 4 && episode.pose < 6 && episode.latency_ticks <= 1);
            assert_eq!(episode.ticks, 450);
            least = least.min(episode.variation.base_mass_offset_kg);
            most = most.max(episode.variation.base_mass_offset_kg);
        }
        assert!(least < -4.9 && most > 4.9, "{least} to {most}");
        let share = |of: &dyn Fn(&Episode) -> bool| all.iter().filter(|one| of(one)).count() as f32 / 2000.0;
        assert!((share(&|one| one.rules.forward_m_per_s == 0.6) - 0.5).abs() < 0.04);
        assert!((share(&|one| one.start_m_per_s > 0.0) - 0.3).abs() < 0.04);
        assert!((share(&|one| one.latency_ticks == 1) - 0.5).abs() < 0.04);
        assert!((share(&|one| one.variant == 3) - 0.25).abs() < 0.04);
    }

    #[test]
    fn first_episodes_end_at_all_times() {
        let ends: Vec<u32> = episodes(true).iter().map(|episode| episode.ticks).collect();
        let early = ends.iter().filter(|ticks| **ticks < 225).count();
        assert!((900..1100).contains(&early) && ends.iter().all(|ticks| (25..=450).contains(ticks)));
    }

    #[test]
    fn pushes_come_again_and_again_within_their_speed() {
        let config = EnvironmentConfig::default();
        let mut episode = Episode::draw(&config, 0, false, stream(1, "episode", &[]));
        let mut ticks = Vec::new();
        for tick in 0..2000 {
            if let Some([x, y, z]) = episode.push_at(tick, &config) {
                assert!(x.hypot(y) <= 0.75 && z == 0.0);
                ticks.push(tick);
            }
        }
        assert!(ticks.len() > 6, "{ticks:?}");
        assert!(ticks.windows(2).all(|pair| (100..=300).contains(&(pair[1] - pair[0]))), "{ticks:?}");
    }
}
