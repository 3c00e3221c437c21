//! Error figures against those of the PyPI package `evo` on the same files (`golden/evo/make.py`).
#![allow(clippy::unwrap_used)]

use std::path::Path;

use libella_host::config::EvaluationSection;
use libella_host::eval::{Trajectory, evaluate};

/// Both are computed in double precision from the same nine decimals; what is left is the order of the sums.
const AGREEMENT_M: f64 = 1e-9;

#[test]
fn absolute_error_and_scale_agree_with_evo_for_both_file_formats() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/evo");
    let evo: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(folder.join("evo.json")).unwrap()).unwrap();
    let estimate = Trajectory::read(&folder.join("estimate.tum")).unwrap();
    for name in ["truth.tum", "truth.csv"] {
        let truth = Trajectory::read(&folder.join(name)).unwrap();
        let found = evaluate(&estimate, &truth, &EvaluationSection::default()).unwrap();
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
        // The scale error of the fixture is 0.5 %: over any distance the relative error has to show at least that.
        assert!(found.rpe.iter().all(|error| error.translation_rmse_percent > 0.5 && error.rotation_rmse_deg < 1e-3), "{:?}", found.rpe);
    }
}
