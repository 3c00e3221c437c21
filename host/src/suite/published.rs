//! What others report on EuRoC, each with how it was measured.
//!
//! Only figures whose origin is named are here; a sequence without one is left out rather than filled from memory. None of them
//! was measured by this program.

/// The sequences of EuRoC in the order of the tables.
pub const EUROC: [&str; 11] = ["V1_01", "V1_02", "V1_03", "V2_01", "V2_02", "V2_03", "MH_01", "MH_02", "MH_03", "MH_04", "MH_05"];

/// One system, or one variant of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Published {
    /// Its name.
    pub name: &'static str,
    /// What it is given.
    pub sensors: &'static str,
    /// Which poses are judged, and how they are aligned.
    pub poses: &'static str,
    /// Whether places seen before are recognised.
    pub loops: &'static str,
    /// Where the figures stand.
    pub source: &'static str,
    /// RMSE of the position, m, in the order of [`EUROC`].
    pub ate_rmse_m: [Option<f64>; 11],
}

const PAPER_SOURCE: &str = "Ji et al., CNN-Augmented Visual-Inertial SLAM with Planar Constraints";

const fn paper(name: &'static str, [a, b, c, d, e]: [f64; 5]) -> Published {
    Published {
        name,
        sensors: "mono-inertial",
        poses: "median of 5 runs; built on ORB-SLAM3, which writes final poses after its local adjustment",
        loops: "off",
        source: PAPER_SOURCE,
        ate_rmse_m: [Some(a), Some(b), Some(c), Some(d), Some(e), None, None, None, None, None, None],
    }
}

/// The paper whose method this is, variant by variant.
pub const PAPER: [Published; 5] = [
    paper("mono-inertial", [0.0367, 0.0605, 0.0767, 0.0480, 0.0620]),
    paper("+ CNN", [0.0352, 0.0151, 0.0381, 0.0320, 0.0404]),
    paper("+ CNN + P", [0.0346, 0.0143, 0.0352, 0.0315, 0.0393]),
    paper("+ CNN + U", [0.0355, 0.0127, 0.0315, 0.0244, 0.0583]),
    paper("+ CNN + U + P", [0.0352, 0.0126, 0.0283, 0.0234, 0.0468]),
];

const fn all(values: [f64; 11]) -> [Option<f64>; 11] {
    let mut some = [None; 11];
    let mut index = 0;
    while index < 11 {
        some[index] = Some(values[index]);
        index += 1;
    }
    some
}

/// Without MH_01, where no second source stands behind the figure.
const fn but_mh_01(values: [f64; 10]) -> [Option<f64>; 11] {
    let mut some = [None; 11];
    let mut index = 0;
    while index < 10 {
        some[if index < 6 { index } else { index + 1 }] = Some(values[index]);
        index += 1;
    }
    some
}

/// Other systems.
pub const SYSTEMS: [Published; 5] = [
    Published {
        name: "ORB-SLAM3",
        sensors: "mono-inertial",
        poses: "final poses, after global adjustment; rigid alignment; median of 10 runs",
        loops: "on",
        source: "Campos et al., IEEE T-RO 2021",
        ate_rmse_m: but_mh_01([0.049, 0.015, 0.037, 0.042, 0.021, 0.027, 0.037, 0.046, 0.075, 0.057]),
    },
    Published {
        name: "DM-VIO",
        sensors: "mono-inertial",
        poses: "odometry; rigid alignment",
        loops: "none",
        source: "von Stumberg and Cremers, IEEE RA-L 2022",
        ate_rmse_m: but_mh_01([0.048, 0.045, 0.069, 0.029, 0.050, 0.114, 0.044, 0.097, 0.102, 0.096]),
    },
    Published {
        name: "OpenVINS",
        sensors: "mono-inertial",
        poses: "causal poses of a filter; alignment by evo",
        loops: "none",
        source: "measured by the authors of XRSLAM, benchmark.md of openxrlab/xrslam",
        ate_rmse_m: all([0.059, 0.084, 0.075, 0.086, 0.074, 0.145, 0.111, 0.287, 0.181, 0.182, 0.365]),
    },
    Published {
        name: "VINS-Mono",
        sensors: "mono-inertial",
        poses: "final poses; rigid alignment",
        loops: "on",
        source: "as Campos et al., IEEE T-RO 2021, give it; listed as post-processed by HybVIO",
        ate_rmse_m: all([0.047, 0.066, 0.180, 0.056, 0.090, 0.244, 0.084, 0.105, 0.074, 0.122, 0.147]),
    },
    Published {
        name: "Basalt",
        sensors: "stereo-inertial",
        poses: "causal poses of a window; rigid alignment",
        loops: "none",
        source: "Usenko et al., IEEE RA-L 2020, two digits",
        ate_rmse_m: [
            Some(0.04),
            Some(0.05),
            Some(0.10),
            Some(0.04),
            Some(0.05),
            None,
            Some(0.07),
            Some(0.06),
            Some(0.07),
            Some(0.13),
            Some(0.11),
        ],
    },
];

/// The sequence of EuRoC that a name begins with: `V1_01` of `V1_01_easy`.
#[must_use]
pub fn euroc_name(name: &str) -> Option<&'static str> {
    EUROC.into_iter().find(|known| name.starts_with(known))
}

impl Published {
    /// Its figure on a sequence of EuRoC.
    #[must_use]
    pub fn on(&self, euroc: &str) -> Option<f64> {
        let index = EUROC.iter().position(|known| *known == euroc)?;
        self.ate_rmse_m.get(index).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means that the sources print themselves.
    #[test]
    fn the_means_are_those_of_the_sources() {
        let mean = |figures: &Published| {
            let known: Vec<f64> = figures.ate_rmse_m.iter().flatten().copied().collect();
            known.iter().sum::<f64>() / known.len() as f64
        };
        for (figures, printed) in PAPER.iter().zip([0.0568, 0.0322, 0.0310, 0.0325, 0.0293]) {
            assert!((mean(figures) - printed).abs() < 1e-4, "{}: {}", figures.name, mean(figures));
        }
        let of = |name: &str| SYSTEMS.iter().find(|system| system.name == name).map_or(0.0, mean);
        assert!((of("ORB-SLAM3") - 0.041).abs() < 5e-4 && (of("DM-VIO") - 0.069).abs() < 5e-4);
        assert!((of("OpenVINS") - 0.150).abs() < 5e-4, "{}", of("OpenVINS"));
        assert!((of("VINS-Mono") - 0.110).abs() < 5e-4, "{}", of("VINS-Mono"));
    }

    #[test]
    fn figures_are_found_by_the_name_of_a_folder() {
        assert_eq!(euroc_name("MH_04_difficult").and_then(|name| SYSTEMS[2].on(name)), Some(0.182));
        assert_eq!(euroc_name("room").and_then(|name| SYSTEMS[2].on(name)), None);
        assert_eq!(SYSTEMS[4].on("V2_03"), None);
    }
}
