//! The main loop: what is due, in the order that the estimator wants it.
//!
//! Time goes in ticks of 5 ms, the period of the inertial sensor. In every tick its samples go first, then the image, if there is
//! one, then the step. On a real machine a tick would end by waiting for the next interrupt.

use libella_core::estimator::{Health, StepBudget};
use libella_core::profile::{Micro, MicroPyramids};
use libella_core::time::{Span, Timestamp};

use crate::cycles::{Clock, Cost};
use crate::driver::{Camera, Imu};
use crate::fault::Fault;
use crate::replay::Replay;
use crate::telemetry::{self, Line, Telemetry};

/// The period of the inertial sensor.
const TICK: Span = Span::from_millis(5);

/// How a recording is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Plan {
    /// What goes wrong.
    pub fault: Fault,
    /// How much of the beginning passes before the sensors are switched on.
    pub skipped: Span,
}

impl Plan {
    /// Every one, with its name on the command line: each fault, and a start in full motion.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "moving" => Some(Self { fault: Fault::None, skipped: Span::from_millis(2_000) }),
            _ => Some(Self { fault: Fault::from_name(name)?, skipped: Span::default() }),
        }
    }
}

/// What the flight came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Summary {
    /// Images taken or refused.
    pub images: u32,
    /// Images with a pose.
    pub poses: u32,
    /// Samples and images that were refused.
    pub refused: u32,
    /// The health at the end.
    pub health: Health,
}

/// Flies the recording to its end and tells every image, every refusal and the end. Samples that are refused one after the other
/// for the same reason are told once.
pub fn fly(
    replay: &Replay<'_>,
    plan: Plan,
    estimator: &mut Micro,
    pyramids: &mut MicroPyramids,
    clock: &mut impl Clock,
    telemetry: &mut impl Telemetry,
) -> Summary {
    let mut summary = Summary { images: 0, poses: 0, refused: 0, health: estimator.health() };
    let Some(first) = replay.sample(0) else { return summary };
    let began = first.stamp + plan.skipped;
    let (mut imu, mut camera) = (Imu::new(replay, plan.fault, began), Camera::new(replay, plan.fault, began));
    let (mut now, mut cost, mut refused_imu) = (began, Cost::default(), None);
    while !imu.is_at_end() {
        while let Some(sample) = imu.poll(now) {
            let begun = clock.now();
            let pushed = estimator.push_imu(sample);
            let ended = clock.now();
            cost.imu = cost.imu.wrapping_add(ended.wrapping_sub(begun));
            let refusal = pushed.err().as_ref().map(telemetry::refusal);
            if let Some(reason) = refusal {
                summary.refused += 1;
                if refused_imu != refusal {
                    at("imu", began, now).word("refused").word(reason).send(telemetry);
                }
            }
            refused_imu = refusal;
        }
        while let Some((stamp, image)) = camera.poll(now) {
            summary.images += 1;
            let begun = clock.now();
            let pushed = estimator.push_image(stamp, &image, pyramids);
            let ended = clock.now();
            cost.image = ended.wrapping_sub(begun);
            if let Err(error) = pushed {
                summary.refused += 1;
                at("image", began, now).word("refused").word(telemetry::refusal(&error)).send(telemetry);
                continue;
            }
            let begun = clock.now();
            let outcome = estimator.step(StepBudget::default());
            let ended = clock.now();
            cost.step = ended.wrapping_sub(begun);
            let line = at("image", began, now).word(telemetry::outcome(outcome));
            match estimator.state().filter(|state| state.stamp == stamp) {
                Some(estimate) => {
                    summary.poses += 1;
                    let (p, q) = (estimate.state.position_in_world, estimate.state.world_from_body.coords);
                    [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().fold(line, Line::bits).send(telemetry);
                }
                None => line.send(telemetry),
            }
            Line::new("cost").decimal(cost.imu).decimal(cost.image).decimal(cost.step).send(telemetry);
            cost = Cost::default();
            clock.end_of_image();
        }
        now = now + TICK;
    }
    summary.health = estimator.health();
    let end = Line::new("end images").decimal(summary.images).word("poses").decimal(summary.poses);
    end.word("refused").decimal(summary.refused).word(telemetry::health(summary.health)).send(telemetry);
    summary
}

/// A line about something that happened now, in milliseconds since the sensors were switched on.
fn at(word: &str, began: Timestamp, now: Timestamp) -> Line {
    Line::new(word).decimal(((now - began).as_nanos() / 1_000_000) as u32)
}
