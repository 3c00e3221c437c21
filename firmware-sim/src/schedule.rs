//! The main loop: what is due, in the order that the estimator wants it.
//!
//! Time goes in ticks of 5 ms, the period of the inertial sensor. In every tick its samples go first, then the image, if there is
//! one, its depth map, if it has one, the step, and the planes. On a real machine a tick would end by waiting for the next interrupt.

use core::num::NonZeroU32;

use libella_core::estimator::{FrameOutcome, Health, StepBudget};
use libella_core::profile::{Micro, MicroPyramids};
use libella_core::time::{Span, Timestamp};

use crate::cycles::{Clock, Cost};
use crate::driver::{Camera, Depth, DepthMemory, Imu};
use crate::fault::Fault;
use libella_core::estimator::Look;

use crate::planes::{Planes, Settings};
use crate::replay::Replay;
use crate::telemetry::{self, Line, Telemetry};

/// Images from one look for planes to the next: three times as often as [`Settings`] has it, or the recording would end before any plane
/// is steady.
const LOOK_EVERY: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
/// The period of the inertial sensor.
const TICK: Span = Span::from_millis(5);

/// How a recording is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Plan {
    /// What goes wrong.
    pub fault: Fault,
    /// How much of the beginning passes before the sensors are switched on.
    pub skipped: Span,
    /// Whether planes are sought and used.
    pub planes: bool,
    /// Whether depth maps are used.
    pub depth: bool,
}

impl Plan {
    /// Every one, with its name on the command line: each fault, planes, depth maps, both of them (`full`), and a start in full motion,
    /// with both too. A fault of the depth maps needs them, the others do without.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let (plain, moving) = (Self::default(), Span::from_millis(2_000));
        Some(match name {
            "planes" => Self { planes: true, ..plain },
            "depth" => Self { depth: true, ..plain },
            "full" => Self { planes: true, depth: true, ..plain },
            "moving" => Self { skipped: moving, ..plain },
            "full-moving" => Self { planes: true, depth: true, skipped: moving, ..plain },
            _ => {
                let fault = Fault::from_name(name)?;
                Self { fault, depth: fault.is_of_depth(), ..plain }
            }
        })
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
    clock: &mut dyn Clock,
    telemetry: &mut dyn Telemetry,
) -> Summary {
    let mut summary = Summary { images: 0, poses: 0, refused: 0, health: estimator.health() };
    let Some(first) = replay.sample(0) else { return summary };
    let began = first.stamp + plan.skipped;
    let mut log = Log { telemetry, began };
    let (mut imu, mut camera) = (Imu::new(replay, plan.fault, began), Camera::new(replay, plan.fault, began));
    let mut depth = plan.depth.then(|| Depth::new(replay, plan.fault, began));
    let mut planes = plan.planes.then(|| Planes::new(Settings { every: LOOK_EVERY, ..Settings::small_images() }));
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
                    log.refused("imu", now, reason);
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
                log.refused("image", now, telemetry::refusal(&error));
                continue;
            }
            if let Some(depth) = &mut depth
                && depth.is_due(stamp)
            {
                let begun = clock.now();
                let refusal = take_depth(depth, stamp, estimator);
                let ended = clock.now();
                cost.depth = ended.wrapping_sub(begun);
                if let Some(reason) = refusal {
                    summary.refused += 1;
                    log.refused("depth", now, reason);
                }
            }
            let begun = clock.now();
            let outcome = estimator.step(StepBudget::even());
            let ended = clock.now();
            cost.step = ended.wrapping_sub(begun);
            log.depth(now, estimator);
            if let Some(planes) = &mut planes {
                let begun = clock.now();
                let look = planes.after_image(stamp, outcome, estimator);
                let ended = clock.now();
                cost.planes = ended.wrapping_sub(begun);
                if let Some(look) = look {
                    log.look(now, &look);
                }
            }
            summary.poses += u32::from(log.image(now, stamp, outcome, estimator));
            log.cost(&cost);
            cost = Cost::default();
            clock.end_of_image();
        }
        now = now + TICK;
    }
    summary.health = estimator.health();
    log.end(planes.as_ref(), &summary);
    summary
}

/// Hands the depth map of an image over; why it was refused, where it was. Its memory is on the stack while nothing else is.
#[inline(never)]
fn take_depth(depth: &mut Depth<'_>, stamp: Timestamp, estimator: &mut Micro) -> Option<&'static str> {
    let mut memory = DepthMemory::default();
    match depth.read(&mut memory) {
        Some(map) => estimator.push_depth(stamp, &map).err().as_ref().map(telemetry::refusal),
        None => Some("no-map"),
    }
}

/// What is told of the flight. Out of line: the lines would be on the stack below the estimator's work.
struct Log<'a> {
    telemetry: &'a mut dyn Telemetry,
    began: Timestamp,
}

impl Log<'_> {
    #[inline(never)]
    fn refused(&mut self, what: &str, now: Timestamp, reason: &str) {
        self.at(what, now).word("refused").word(reason).send(self.telemetry);
    }

    #[inline(never)]
    fn depth(&mut self, now: Timestamp, estimator: &Micro) {
        if let Some(report) = estimator.report().depth {
            self.at("depth", now).word(telemetry::verdict(report.verdict)).decimal(report.given as u32).send(self.telemetry);
        }
    }

    #[inline(never)]
    fn look(&mut self, now: Timestamp, look: &Look) {
        let line = self.at("planes", now).decimal(look.samples as u32).word("found").decimal(look.found as u32);
        let line = line.word("known").decimal(look.known as u32).word("steady").decimal(look.steady as u32);
        line.word("attached").decimal(look.attached as u32).send(self.telemetry);
    }

    /// Whether there is a pose.
    #[inline(never)]
    fn image(&mut self, now: Timestamp, stamp: Timestamp, outcome: FrameOutcome, estimator: &Micro) -> bool {
        let line = self.at("image", now).word(telemetry::outcome(outcome));
        let Some(estimate) = estimator.state().filter(|state| state.stamp == stamp) else {
            line.send(self.telemetry);
            return false;
        };
        let (p, q) = (estimate.state.position_in_world, estimate.state.world_from_body.coords);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().fold(line, Line::bits).send(self.telemetry);
        true
    }

    #[inline(never)]
    fn cost(&mut self, cost: &Cost) {
        [cost.imu, cost.image, cost.depth, cost.step, cost.planes].into_iter().fold(Line::new("cost"), Line::decimal).send(self.telemetry);
    }

    #[inline(never)]
    fn end(&mut self, planes: Option<&Planes>, summary: &Summary) {
        for plane in planes.into_iter().flat_map(Planes::steady).map(|(_, plane)| plane) {
            let (normal, line) = (plane.plane.normal_in_world, Line::new("plane").word(telemetry::class(plane.class)));
            [normal.x, normal.y, normal.z, plane.plane.offset_m].into_iter().fold(line, Line::bits).send(self.telemetry);
        }
        let end = Line::new("end images").decimal(summary.images).word("poses").decimal(summary.poses);
        end.word("refused").decimal(summary.refused).word(telemetry::health(summary.health)).send(self.telemetry);
    }

    /// A line about something that happened now, in milliseconds since the sensors were switched on.
    fn at(&self, word: &str, now: Timestamp) -> Line {
        Line::new(word).decimal(((now - self.began).as_nanos() / 1_000_000) as u32)
    }
}
