//! Lines of text without the standard formatter, which alone would take as much flash as the estimator's front end.
//!
//! Numbers that matter are printed as the hexadecimal bits of their `f32`, so that a pose is exact.

use libella_core::depth::Verdict;
use libella_core::estimator::{FrameOutcome, Health, InputError, Waiting};
use libella_core::plane::PlaneClass;

/// Where lines go.
pub trait Telemetry {
    /// Takes one line with its end.
    fn send(&mut self, line: &[u8]);
}

/// A line being written; what does not fit is cut off.
#[derive(Debug)]
pub struct Line {
    bytes: [u8; 120],
    length: usize,
}

impl Line {
    /// A line that begins with `word`.
    #[must_use]
    pub fn new(word: &str) -> Self {
        let mut line = Self { bytes: [0; 120], length: 0 };
        line.text(word);
        line
    }

    /// Sends it.
    pub fn send(mut self, telemetry: &mut dyn Telemetry) {
        self.text("\n");
        telemetry.send(self.bytes.get(..self.length).unwrap_or_default());
    }

    /// Adds a word.
    #[must_use]
    pub fn word(mut self, word: &str) -> Self {
        self.text(" ");
        self.text(word);
        self
    }

    /// Adds a whole number.
    #[must_use]
    pub fn decimal(mut self, value: u32) -> Self {
        let (mut digits, mut rest, mut first) = ([0_u8; 10], value, 10);
        for digit in digits.iter_mut().rev() {
            *digit = b'0' + (rest % 10) as u8;
            rest /= 10;
            first -= 1;
            if rest == 0 {
                break;
            }
        }
        self.text(" ");
        self.write(digits.get(first..).unwrap_or_default());
        self
    }

    /// Adds the bits of a number.
    #[must_use]
    pub fn bits(mut self, value: f32) -> Self {
        let bits = value.to_bits();
        self.text(" ");
        for nibble in (0..8).rev() {
            let digit = (bits >> (4 * nibble)) as u8 & 15;
            self.write(&[if digit < 10 { b'0' + digit } else { b'a' + digit - 10 }]);
        }
        self
    }

    fn text(&mut self, text: &str) {
        self.write(text.as_bytes());
    }

    #[inline(never)]
    fn write(&mut self, bytes: &[u8]) {
        for (place, byte) in self.bytes.iter_mut().skip(self.length).zip(bytes) {
            *place = *byte;
            self.length += 1;
        }
    }
}

/// The name of an outcome.
#[must_use]
pub fn outcome(outcome: FrameOutcome) -> &'static str {
    match outcome {
        FrameOutcome::NoFrame => "no-frame",
        FrameOutcome::NeedImu => "need-imu",
        FrameOutcome::Initialising(waiting) => waits(waiting),
        FrameOutcome::Initialised => "initialised",
        FrameOutcome::Tracked => "tracked",
        FrameOutcome::NewKeyframe => "keyframe",
        FrameOutcome::Coasted => "coasted",
        FrameOutcome::Lost => "lost",
        _ => "unknown",
    }
}

/// The name of a health.
#[must_use]
pub fn health(health: Health) -> &'static str {
    match health {
        Health::Initialising(waiting) => waits(waiting),
        Health::Tracking => "tracking",
        Health::Degraded => "degraded",
        Health::Lost => "lost",
        _ => "unknown",
    }
}

/// The name of a refusal.
#[must_use]
pub fn refusal(error: &InputError) -> &'static str {
    match error {
        InputError::NotFinite(_) => "not-finite",
        InputError::Stale(_) => "stale",
        InputError::WrongImageSize { .. } => "wrong-image-size",
        InputError::MissingImu(_) => "missing-imu",
        InputError::PyramidTooSmall { .. } => "pyramid-too-small",
        InputError::NoSuchImage(_) => "no-such-image",
        InputError::Full => "full",
        _ => "unknown",
    }
}

/// The name of what became of a depth map.
#[must_use]
pub fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Believed => "believed",
        Verdict::OtherScale => "other-scale",
        Verdict::NoDepth => "no-depth",
    }
}

/// The name of a kind of plane.
#[must_use]
pub fn class(class: PlaneClass) -> &'static str {
    match class {
        PlaneClass::Floor => "floor",
        PlaneClass::Ceiling => "ceiling",
        PlaneClass::Wall => "wall",
        PlaneClass::Table => "table",
        _ => "other",
    }
}

fn waits(waiting: Waiting) -> &'static str {
    match waiting {
        Waiting::Imu => "waits-for-imu",
        Waiting::Tracks => "waits-for-tracks",
        Waiting::Parallax => "waits-for-parallax",
        Waiting::Excitation => "waits-for-excitation",
        Waiting::Gravity => "waits-for-gravity",
        Waiting::Agreement => "waits-for-agreement",
        Waiting::Computation => "computes-its-start",
        _ => "waits",
    }
}
