//! Noise densities against the quietest second of the recording.
//!
//! # Model
//! White noise of density `σ_c` sampled every `Δt` has Allan variance `σ_A²(τ) = σ_c²/τ`; at rest it is read at `τ = 10 Δt`. The second
//! difference, `rms(Δ²x) = √6 σ_c/√Δt`, suppresses motion, but not vibration; the Allan variance suppresses vibration, but not motion.
//! At rest both agree; else the smaller of the two bounds the noise from above.
//!
//! # Mix-ups
//! ```text
//! variance for sigma       stated = σ_c²            measured ≈ √stated
//! per sample for density   stated = σ_c √rate       measured ≈ stated/√rate, of both sensors
//! scaled twice             stated = σ_c/√rate       measured ≈ stated √rate, of both sensors, at rest
//! ```

use nalgebra::Vector3;

use super::Material;
use super::finding::{FindingKind, Findings, Noise, Severity};

/// Length of the window, s, and the number of samples in a cluster of the Allan variance.
const WINDOW_S: f64 = 1.0;
const CLUSTER: usize = 10;
/// A window is at rest when its quarters' means differ by less: rad/s, m/s² (the limits of a resting start).
const REST_SPREAD: [f64; 2] = [0.01, 0.05];
/// and both figures of its noise agree within this factor, as white noise has it.
const WHITE: f64 = 2.0;
/// Densities below which no microelectromechanical unit is: a tenth of the best gyro's, a third of the best accelerometer's.
const LEAST_DENSITY: [f64; 2] = [2e-6, 3e-5];
/// Measured over stated from which a stated value cannot be a sigma; vibration of propellers reaches 30.
const VARIANCE_RATIO: f64 = 30.0;
/// A mix-up is believed when the figures agree this well, as a factor.
const AGREEMENT: f64 = 1.6;
/// Measured at rest over stated, and its inverse, beyond which weights are wrong. Many inflate densities tenfold on purpose.
const UNDERSTATED: f64 = 10.0;
const OVERSTATED: f64 = 100.0;

struct Quiet {
    density: [f64; 2],
    at_rest: bool,
}

/// Compares both sensors with their stated densities.
pub(super) fn check(material: &mut Material, findings: &mut Findings) {
    let Some(rate_hz) = material.figures.imu.map(|clock| clock.rate_hz) else { return };
    let Some(quiet) = quietest(material, rate_hz) else { return };
    let stated = [material.noise.gyro_noise_density, material.noise.accel_noise_density];
    let of = |sensor: usize| Noise { stated: stated[sensor], measured: quiet.density[sensor], at_rest: quiet.at_rest };
    material.figures.gyro_noise = Some(of(0));
    material.figures.accel_noise = Some(of(1));
    let ratio = [0, 1].map(|sensor| quiet.density[sensor] / stated[sensor]);
    let both_near = |target: f64| ratio.iter().all(|ratio| (ratio / target).ln().abs() < AGREEMENT.ln());
    let units = ["rad/s/sqrt(Hz)", "m/s^2/sqrt(Hz)"];
    let names = ["gyroscope_noise_density", "accelerometer_noise_density"];
    let mut squared = false;
    for sensor in 0..2 {
        let root = stated[sensor].sqrt();
        let is_square = (quiet.density[sensor] / root).ln().abs() < 4.0_f64.ln();
        if ratio[sensor] > VARIANCE_RATIO && (is_square || stated[sensor] < LEAST_DENSITY[sensor]) {
            squared = true;
            let measured =
                format!("{} is {:.2e}, the recording shows {:.2e} {}", names[sensor], stated[sensor], quiet.density[sensor], units[sensor]);
            let change = format!(
                "a variance stands where a standard deviation belongs: write its root, {root:.2e}, and do the same with the other densities"
            );
            findings.add(Severity::Fault, FindingKind::NoiseDensity, measured, "a density that covers the noise of the recording", change);
        }
    }
    if squared {
        return;
    }
    let root = rate_hz.sqrt();
    if both_near(1.0 / root) {
        let measured = format!("both densities are {:.0} and {:.0} times what the recording shows", 1.0 / ratio[0], 1.0 / ratio[1]);
        let change = format!("they look like values per sample: divide them by the root of the rate, {root:.1}");
        findings.add(Severity::Warning, FindingKind::NoiseDensity, measured, "continuous-time densities, per sqrt(Hz)", change);
    } else if quiet.at_rest && both_near(root) {
        let measured = format!("the recording shows {:.0} and {:.0} times the stated densities at rest", ratio[0], ratio[1]);
        let change = format!("they look divided by the root of the rate: multiply them by {root:.1}");
        findings.add(Severity::Warning, FindingKind::NoiseDensity, measured, "continuous-time densities, per sqrt(Hz)", change);
    } else {
        for sensor in 0..2 {
            let measured =
                format!("{} is {:.2e}, the recording shows {:.2e} {}", names[sensor], stated[sensor], quiet.density[sensor], units[sensor]);
            if quiet.at_rest && ratio[sensor] > UNDERSTATED {
                let change = format!("state at least {:.1e}, or find what shakes the sensor at rest", quiet.density[sensor]);
                findings.add(Severity::Warning, FindingKind::NoiseDensity, measured, "a density that covers the noise at rest", change);
            } else if ratio[sensor] < 1.0 / OVERSTATED {
                let change = format!("state about {:.1e}, ten times that for a cautious filter", quiet.density[sensor]);
                findings.add(Severity::Warning, FindingKind::NoiseDensity, measured, "a density within 100 times of the noise", change);
            }
        }
    }
}

/// The quietest window: one at rest if there is any, else the one of the smallest second difference.
fn quietest(material: &Material, rate_hz: f64) -> Option<Quiet> {
    let length = (WINDOW_S * rate_hz).round() as usize;
    if length < 4 * CLUSTER {
        return None;
    }
    let mut best: Option<(bool, f64, Quiet)> = None;
    for window in material.imu.chunks_exact(length) {
        let gyro: Vec<_> = window.iter().map(|sample| sample.gyro_rad_s).collect();
        let accel: Vec<_> = window.iter().map(|sample| sample.accel_m_s2).collect();
        let (slow, fast) = ([&gyro, &accel].map(|x| allan_density(x, rate_hz)), [&gyro, &accel].map(|x| difference_density(x, rate_hz)));
        let is_white = slow.iter().zip(&fast).all(|(slow, fast)| slow < &(WHITE * fast) && fast < &(WHITE * slow));
        let at_rest = is_white && spread(&gyro) < REST_SPREAD[0] && spread(&accel) < REST_SPREAD[1];
        let density = if at_rest { slow } else { [0, 1].map(|sensor| slow[sensor].min(fast[sensor])) };
        // Numbers that never change are no noise.
        if density.iter().any(|density| !(density.is_finite() && *density > 0.0)) {
            continue;
        }
        let loudness = density[0] * density[1];
        if best.as_ref().is_none_or(|(rested, least, _)| (at_rest, -loudness) > (*rested, -*least)) {
            best = Some((at_rest, loudness, Quiet { density, at_rest }));
        }
    }
    best.map(|(_, _, quiet)| quiet)
}

fn mean(values: &[Vector3<f64>]) -> Vector3<f64> {
    values.iter().sum::<Vector3<f64>>() / values.len().max(1) as f64
}

/// Largest distance of a quarter's mean from that of the window.
fn spread(values: &[Vector3<f64>]) -> f64 {
    let center = mean(values);
    values.chunks_exact((values.len() / 4).max(1)).map(|quarter| (mean(quarter) - center).norm()).fold(0.0, f64::max)
}

/// Density from the Allan variance of ten-sample clusters, the root mean square of three axes.
fn allan_density(values: &[Vector3<f64>], rate_hz: f64) -> f64 {
    let means: Vec<_> = values.chunks_exact(CLUSTER).map(mean).collect();
    let sum: f64 = means.windows(2).map(|pair| (pair[1] - pair[0]).norm_squared() / 3.0).sum();
    (0.5 * sum / (means.len() - 1) as f64 * CLUSTER as f64 / rate_hz).sqrt()
}

fn difference_density(values: &[Vector3<f64>], rate_hz: f64) -> f64 {
    let sum: f64 = values.windows(3).map(|x| (x[0] - x[1] * 2.0 + x[2]).norm_squared() / 3.0).sum();
    (sum / 6.0 / (values.len() - 2) as f64 / rate_hz).sqrt()
}
