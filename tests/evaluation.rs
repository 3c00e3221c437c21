//! Error figures against those of the PyPI package `evo` on the same files (`golden/evo/make.py`).

use std::path::Path;

use libella_host::config::EvaluationSection;
use libella_host::eval::{Evaluation, Trajectory, evaluate};
use serde_json::Value;

/// Both are computed in double precision from the same nine decimals; what is left is the order of the sums.
const AGREEMENT_M: f64 = 1e-9;
/// A quaternion of nine decimals is no unit one by that much, and the two make it one differently.
const AGREEMENT_DEG: f64 = 1e-7;

fn compared(truth: &str, estimate: &str, rpe_distances_m: &[f64]) -> (Evaluation, Value) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/evo");
    let read = |name| Trajectory::read(&folder.join(name)).unwrap();
    let options = EvaluationSection { rpe_distances_m: rpe_distances_m.to_vec(), ..EvaluationSection::default() };
    let found = evaluate(&read(estimate), &read(truth), &options).unwrap();
    (found, serde_json::from_str(&std::fs::read_to_string(folder.join("evo.json")).unwrap()).unwrap())
}

fn assert_relative_errors(found: &Evaluation, evo: &Value) {
    assert_eq!(found.rpe.len(), evo.as_array().unwrap().len());
    for (found, evo) in found.rpe.iter().zip(evo.as_array().unwrap()) {
        let expected = |pointer: &str| evo.pointer(pointer).and_then(Value::as_f64).unwrap();
        let distance = expected("/distance");
        assert_eq!((found.distance_m, found.pairs as f64), (distance, expected("/pairs")));
        for (pointer, value, agreement) in [
            ("/translation/rmse", found.translation_rmse_m, AGREEMENT_M),
            ("/translation/median", found.translation_median_m, AGREEMENT_M),
            ("/rotation_deg/rmse", found.rotation_rmse_deg, AGREEMENT_DEG),
        ] {
            let expected = expected(pointer);
            assert!((value - expected).abs() < agreement, "{pointer} over {distance} m is {value}, evo says {expected}");
        }
    }
}

#[test]
fn errors_and_scale_agree_with_evo_for_both_file_formats() {
    for name in ["truth.tum", "truth.csv"] {
        let (found, evo) = compared(name, "estimate.tum", &[0.5, 1.0, 2.0, 5.0, 10.0]);
        assert_eq!((found.matched_poses, found.unmatched_poses), (240, 0), "{name}");
        let figures = [
            ("rmse", found.ate_rmse_m),
            ("mean", found.ate_m.mean),
            ("median", found.ate_m.median),
            ("max", found.ate_m.max),
            ("scale", found.scale),
        ];
        for (key, value) in figures {
            let expected = evo[key].as_f64().unwrap();
            assert!((value - expected).abs() < AGREEMENT_M, "{name}: {key} is {value}, evo says {expected}");
        }
        assert_relative_errors(&found, &evo["rpe"]);
    }
}

#[test]
fn relative_errors_agree_with_evo_where_poses_are_equally_far_or_stand_still() {
    let (found, evo) = compared("pauses_truth.tum", "pauses_estimate.tum", &[0.9375, 2.0625, 3.0]);
    assert_relative_errors(&found, &evo["pauses"]);
}
