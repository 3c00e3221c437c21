//! The images: size, exposure, detail, content.

use super::Material;
use super::finding::{FindingKind, Findings, Pictures, Severity};
use super::sightings::Sightings;

/// Mean grey levels between which a camera is well exposed, generously.
const GREY: [f64; 2] = [15.0, 240.0];
/// Share of black or white pixels from which corners are missing there.
const LOST_SHARE: f64 = 0.4;
/// Change of the mean grey level from image to image that Lucas-Kanade tracking without gain correction suffers from.
const FLICKER: f64 = 12.0;
/// Corners followed of 200 below which poses get poor, and below which there are none.
const FOLLOWED: [f64; 2] = [40.0, 12.0];
/// Share of images equal to the one before: a camera's noise never repeats itself.
const REPEATED_SHARE: f64 = 0.05;

/// Judges the images; a size that differs from the calibration's replaces it.
pub(super) fn check(material: &mut Material, seen: &Sightings, findings: &mut Findings) {
    if let Some((width, height)) = seen.size_px {
        check_size(material, (width, height), findings);
    }
    if let (count @ 1.., Some(reason)) = &seen.unread {
        let measured = format!("{count} images cannot be used, first: {reason}");
        findings.add(
            Severity::Warning,
            FindingKind::ImageContent,
            measured,
            "images that can be decoded, of at most 1.5 megapixels",
            "copy them again, or make them smaller",
        );
    }
    let Some(pictures) = seen.pictures else { return };
    material.figures.pictures = Some(pictures);
    judge(&pictures, findings);
}

fn check_size(material: &mut Material, (width, height): (u32, u32), findings: &mut Findings) {
    let (stated_width, stated_height) = material.size_px();
    if (width, height) == (stated_width, stated_height) {
        return;
    }
    material.size_is_wrong = true;
    let ratio = f64::from(width) / f64::from(stated_width);
    let same_shape = (ratio / (f64::from(height) / f64::from(stated_height)) - 1.0).abs() < 0.01;
    let change = if same_shape {
        format!(
            "give the size of these images; if they were scaled after calibration, multiply all four intrinsics by {ratio:.4}, else leave them"
        )
    } else {
        "use the calibration of this camera at this resolution; if the images were cut, subtract the cut from the principal point".into()
    };
    let measured = format!("images are {width}x{height}");
    let expected = format!("{stated_width}x{stated_height}, as the calibration says");
    findings.add(Severity::Fault, FindingKind::ImageSize, measured, expected, change);
    material.set_size_px((width, height));
}

fn judge(pictures: &Pictures, findings: &mut Findings) {
    let Pictures { grey, dark_share, bright_share, flicker, sharpness, followed, .. } = *pictures;
    if !(GREY[0]..=GREY[1]).contains(&grey) || dark_share > LOST_SHARE && grey < 40.0 || bright_share > LOST_SHARE {
        let measured =
            format!("mean grey level {grey:.0}, {:.0} % of the pixels black, {:.0} % white", 100.0 * dark_share, 100.0 * bright_share);
        let change = if grey > 127.0 {
            "shorten the exposure or lower the gain"
        } else {
            "add light or gain, or expose longer while that does not blur"
        };
        findings.add(Severity::Warning, FindingKind::Exposure, measured, "images with detail in the shadows and the lights", change);
    }
    if flicker > FLICKER {
        let measured = format!("brightness changes by {flicker:.0} grey levels from image to image");
        let change = "fix the exposure, slow down its control, or use lamps that do not flicker";
        findings.add(Severity::Warning, FindingKind::Exposure, measured, format!("less than {FLICKER} grey levels"), change);
    }
    if pictures.looked_at > 2 && followed < FOLLOWED[0] {
        let severity = if followed < FOLLOWED[1] { Severity::Fault } else { Severity::Warning };
        let blurred = if sharpness < 0.32 { ", and they look blurred" } else { "" };
        let measured = format!("{followed:.0} corners are followed from image to image{blurred}");
        let change =
            "shorten the exposure against motion blur, focus the lens, look at a scene with more texture, or use more images per second";
        findings.add(severity, FindingKind::Detail, measured, format!("at least {:.0} of 200", FOLLOWED[0]), change);
    }
}

/// Repeated images while the inertial unit moves; of a resting rig a repeated image says nothing more.
pub(super) fn check_repeats(pictures: &Pictures, moves: bool, findings: &mut Findings) {
    if moves && pictures.repeated_share > REPEATED_SHARE {
        let severity = if pictures.repeated_share > 0.5 { Severity::Fault } else { Severity::Warning };
        let measured =
            format!("{:.0} % of the images are equal to the one before while the inertial unit moves", 100.0 * pictures.repeated_share);
        let change = "find out why the driver hands out old images; remove the repeated ones";
        findings.add(severity, FindingKind::ImageContent, measured, "new images", change);
    }
}
