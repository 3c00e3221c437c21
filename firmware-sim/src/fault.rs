//! Sensors that fail, on purpose.

use libella_core::time::{Span, Timestamp};

/// What goes wrong [`START`] after the beginning of the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// The inertial sensor answers with what is not a number, for 0.1 s.
    NanImu,
    /// The camera shows the same picture for 1 s.
    StuckCamera,
    /// The clock of both sensors is 1 s behind, for 0.5 s.
    TimeBack,
    /// Neither sensor answers for 2 s.
    Gap,
    /// Depth maps of what is no number, for 2 s.
    NanDepth,
    /// Depth maps of zeros, for 2 s.
    ZeroDepth,
    /// Depth maps with near for far and far for near, for 2 s.
    InvertedDepth,
}

/// When the fault begins.
pub const START: Span = Span::from_millis(3_500);

impl Fault {
    /// Every one, with its name on the command line.
    pub const ALL: [(&'static str, Self); 8] = [
        ("none", Self::None),
        ("nan-imu", Self::NanImu),
        ("stuck-camera", Self::StuckCamera),
        ("time-back", Self::TimeBack),
        ("gap", Self::Gap),
        ("nan-depth", Self::NanDepth),
        ("zero-depth", Self::ZeroDepth),
        ("inverted-depth", Self::InvertedDepth),
    ];

    /// The fault of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(known, _)| *known == name).map(|(_, fault)| fault)
    }

    /// Whether it is one of depth maps.
    #[must_use]
    pub fn is_of_depth(self) -> bool {
        matches!(self, Self::NanDepth | Self::ZeroDepth | Self::InvertedDepth)
    }

    fn lasts(self) -> Span {
        Span::from_millis(match self {
            Self::None => 0,
            Self::NanImu => 100,
            Self::StuckCamera => 1_000,
            Self::TimeBack => 500,
            Self::Gap | Self::NanDepth | Self::ZeroDepth | Self::InvertedDepth => 2_000,
        })
    }

    /// Whether it is upon the sensors, this long after the beginning.
    #[must_use]
    pub fn is_on(self, elapsed: Span) -> bool {
        elapsed >= START && elapsed.as_nanos() < START.as_nanos() + self.lasts().as_nanos()
    }

    /// What a sensor writes on its measurement of `stamp`.
    #[must_use]
    pub fn stamped(self, elapsed: Span, stamp: Timestamp) -> Timestamp {
        if self == Self::TimeBack && self.is_on(elapsed) { stamp - Span::from_millis(1_000) } else { stamp }
    }
}
