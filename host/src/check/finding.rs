//! What a check found, in words for a person and in JSON for a program.

use std::fmt::{self, Write as _};

use serde::Serialize;

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Worth knowing.
    Note,
    /// Accuracy suffers.
    Warning,
    /// No good trajectory can come out.
    Fault,
}

/// What a finding is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum FindingKind {
    /// Time stamps in another unit than nanoseconds.
    StampUnit,
    /// Time stamps that occur twice.
    StampDuplicate,
    /// Time stamps that go back.
    StampOrder,
    /// Pauses between samples or images.
    StampGap,
    /// Uneven time stamps.
    StampJitter,
    /// Camera and inertial unit are stamped by different clocks.
    Clock,
    /// Angular rates in another unit than rad/s.
    GyroUnit,
    /// Specific forces in another unit than m/s².
    AccelUnit,
    /// Specific force without gravity, or of another magnitude.
    Gravity,
    /// Axes of the gyro or the accelerometer exchanged or turned round.
    ImuAxes,
    /// Angular rates that stop at an end of the range.
    GyroSaturated,
    /// Specific forces that stop at an end of the range.
    AccelSaturated,
    /// An axis that always says the same.
    ImuStuck,
    /// Noise densities that do not fit the recording.
    NoiseDensity,
    /// Images of another size than the calibration's.
    ImageSize,
    /// Images too dark, too bright, or flickering.
    Exposure,
    /// Images with too little detail to follow.
    Detail,
    /// Images that repeat, or cannot be read.
    ImageContent,
    /// Focal length, principal point or distortion that do not fit the motion.
    Intrinsics,
    /// `T_BS` maps the wrong way.
    ExtrinsicInverted,
    /// The rotation between camera and inertial unit.
    ExtrinsicRotation,
    /// The time between the stamps of camera and inertial unit.
    TimeOffset,
    /// Image motion and gyro have nothing in common.
    Disagreement,
    /// Nothing moves.
    Static,
    /// Too little motion to start from.
    Motion,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What it is about.
    pub kind: FindingKind,
    /// How much it matters.
    pub severity: Severity,
    /// What was measured.
    pub measured: String,
    /// What was expected.
    pub expected: String,
    /// What to change.
    pub change: String,
}

/// Collects findings.
#[derive(Debug, Default)]
pub(super) struct Findings(pub Vec<Finding>);

impl Findings {
    /// Adds one.
    pub fn add(
        &mut self,
        severity: Severity,
        kind: FindingKind,
        measured: impl Into<String>,
        expected: impl Into<String>,
        change: impl Into<String>,
    ) {
        self.0.push(Finding { kind, severity, measured: measured.into(), expected: expected.into(), change: change.into() });
    }

    /// Whether something of this kind and at least this severity was found.
    pub fn has(&self, kind: FindingKind, severity: Severity) -> bool {
        self.0.iter().any(|finding| finding.kind == kind && finding.severity >= severity)
    }
}

/// A value that may not be observable, with its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// Whether the motion tells it.
    pub observable: bool,
}

impl fmt::Display for Measured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.observable { write!(f, "{:.2} ± {:.2}", self.value, self.sigma) } else { f.write_str("not observable") }
    }
}

/// What gyro and images say about each other.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraImu {
    /// Time to add to the stamps of the camera, ms: `t_imu = t_camera + offset`.
    pub time_offset_ms: Measured,
    /// Angle between the stated and the measured rotation of the camera, degrees; sigma is that of the worst axis.
    pub rotation_off_deg: Measured,
    /// The measured `R_BC` as a rotation vector from the stated one, degrees, in the camera frame.
    pub rotation_off_vector_deg: [f64; 3],
    /// Measured focal lengths over the stated ones.
    pub focal_ratio: [Measured; 2],
    /// Measured minus stated principal point, px.
    pub center_off_px: [Measured; 2],
    /// Measured minus stated first coefficient of the distortion.
    pub distortion_off: Measured,
    /// Gyro bias, rad/s.
    pub gyro_bias_rad_s: [f64; 3],
    /// Correlation of image rotation and gyro, 0 to 1.
    pub correlation: f64,
    /// Distance of the corners from their epipolar lines, px (robust standard deviation).
    pub residual_px: f64,
    /// Displacement beyond rotation over half a second, px (90 % of the corners are below it).
    pub parallax_px: f64,
    /// Pairs of images used.
    pub pairs: usize,
}

/// Figures of one sensor's clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Clock {
    /// Samples or images per second.
    pub rate_hz: f64,
    /// Robust standard deviation of the interval, ms.
    pub jitter_ms: f64,
    /// Longest pause, ms.
    pub longest_gap_ms: f64,
}

/// Noise of one sensor, rad/s/√Hz or m/s²/√Hz.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Noise {
    /// As stated.
    pub stated: f64,
    /// In the quietest second of the recording.
    pub measured: f64,
    /// Whether the sensor was at rest in it; if not, vibration and motion are part of the figure.
    pub at_rest: bool,
}

/// Figures of the images that were looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Pictures {
    /// How many were looked at.
    pub looked_at: usize,
    /// Median of their mean grey level.
    pub grey: f64,
    /// Median share of pixels at the dark end.
    pub dark_share: f64,
    /// Median share of pixels at the bright end.
    pub bright_share: f64,
    /// Median change of the mean grey level from image to image.
    pub flicker: f64,
    /// Energy of neighbouring differences over that of differences across two pixels: 0.25 blurred, 0.5 sharp edges, 1 noise.
    pub sharpness: f64,
    /// Share of images equal to the one before.
    pub repeated_share: f64,
    /// Median number of corners followed from the image before.
    pub followed: f64,
}

/// All figures, for those who want more than findings.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Figures {
    /// The inertial unit's clock.
    pub imu: Option<Clock>,
    /// The camera's clock.
    pub camera: Option<Clock>,
    /// Mean magnitude of specific force, m/s², after correction of its unit.
    pub gravity_m_s2: Option<f64>,
    /// Direction of up in camera coordinates (x right, y down, z forward), mean over the recording.
    pub up_in_camera: Option<[f64; 3]>,
    /// Noise of the gyro.
    pub gyro_noise: Option<Noise>,
    /// Noise of the accelerometer.
    pub accel_noise: Option<Noise>,
    /// The images.
    pub pictures: Option<Pictures>,
    /// Camera against inertial unit.
    pub camera_imu: Option<CameraImu>,
}

/// The outcome of a check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Name of the recording.
    pub recording: String,
    /// From the first to the last image, s.
    pub span_s: f64,
    /// Number of images.
    pub frames: usize,
    /// Number of inertial samples.
    pub imu_samples: usize,
    /// The worst severity.
    pub worst: Severity,
    /// Findings, the worst first.
    pub findings: Vec<Finding>,
    /// Figures.
    pub figures: Figures,
}

impl Report {
    /// Whether something of this kind and at least this severity was found.
    #[must_use]
    pub fn has(&self, kind: FindingKind, severity: Severity) -> bool {
        self.findings.iter().any(|finding| finding.kind == kind && finding.severity >= severity)
    }

    /// Number of findings of a severity.
    #[must_use]
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.severity == severity).count()
    }
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Fault => "FAULT",
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "recording       {} ({:.1} s, {} images, {} inertial samples)",
            self.recording, self.span_s, self.frames, self.imu_samples
        )?;
        if let Some(found) = &self.figures.camera_imu {
            writeln!(f, "time offset     {} ms to add to the camera's stamps", found.time_offset_ms)?;
            writeln!(f, "rotation        {} deg from the stated T_BS", found.rotation_off_deg)?;
            let [x, y] = found.focal_ratio;
            writeln!(f, "focal length    {x} and {y} of the stated (x, y)")?;
            writeln!(f, "image rotation  correlates {:.3} with the gyro; corners {:.2} px off", found.correlation, found.residual_px)?;
        }
        for (name, noise) in [("gyro noise", self.figures.gyro_noise), ("accel noise", self.figures.accel_noise)] {
            if let Some(noise) = noise {
                let when = if noise.at_rest { "at rest" } else { "in the quietest second" };
                writeln!(f, "{name:<16}{:.2e} {when}, {:.2e} stated, per sqrt(Hz)", noise.measured, noise.stated)?;
            }
        }
        if let Some(gravity) = self.figures.gravity_m_s2 {
            writeln!(f, "specific force  {gravity:.3} m/s^2 in the mean")?;
        }
        for finding in &self.findings {
            let mut text = String::new();
            write!(text, "\n{}: {}", finding.severity, finding.measured)?;
            write!(text, "\n  expected: {}", finding.expected)?;
            write!(text, "\n  change:   {}", finding.change)?;
            writeln!(f, "{text}")?;
        }
        let (faults, warnings) = (self.count(Severity::Fault), self.count(Severity::Warning));
        let plural = |count: usize| if count == 1 { "" } else { "s" };
        match (faults, warnings) {
            (0, 0) => writeln!(f, "\nnothing speaks against this recording"),
            _ => writeln!(f, "\n{faults} fault{}, {warnings} warning{}", plural(faults), plural(warnings)),
        }
    }
}
