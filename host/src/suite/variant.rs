//! The parts of the method that a table switches on one after the other.

use serde::{Deserialize, Serialize};

use crate::config::Config;

/// What the estimator is given beside images and inertial samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Variant {
    /// Images and inertial samples alone.
    #[serde(rename = "mono")]
    Mono,
    /// Depth from a network, whose uncertainty is ignored.
    #[serde(rename = "cnn")]
    Cnn,
    /// The same with landmarks drawn to planes.
    #[serde(rename = "cnn+p")]
    CnnPlanes,
    /// Depth that counts by its uncertainty.
    #[serde(rename = "cnn+u")]
    CnnUncertainty,
    /// The same with landmarks drawn to planes.
    #[serde(rename = "cnn+u+p")]
    CnnUncertaintyPlanes,
}

impl Variant {
    /// All of them, in the order of the paper's table.
    pub const ALL: [Self; 5] = [Self::Mono, Self::Cnn, Self::CnnPlanes, Self::CnnUncertainty, Self::CnnUncertaintyPlanes];

    /// The name in files and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mono => "mono",
            Self::Cnn => "cnn",
            Self::CnnPlanes => "cnn+p",
            Self::CnnUncertainty => "cnn+u",
            Self::CnnUncertaintyPlanes => "cnn+u+p",
        }
    }

    /// The name above a column.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Mono => "mono-inertial",
            Self::Cnn => "+ CNN",
            Self::CnnPlanes => "+ CNN + P",
            Self::CnnUncertainty => "+ CNN + U",
            Self::CnnUncertaintyPlanes => "+ CNN + U + P",
        }
    }

    /// The variant of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|variant| variant.name() == name)
    }

    /// Whether it needs depth.
    #[must_use]
    pub fn has_depth(self) -> bool {
        self != Self::Mono
    }

    /// The configuration of it, with depth from `depth`.
    #[must_use]
    pub fn applied_to(self, config: &Config, depth: &str) -> Config {
        let mut config = config.clone();
        config.depth.source = if self.has_depth() { depth.to_owned() } else { "none".into() };
        config.depth.uncertainty = matches!(self, Self::CnnUncertainty | Self::CnnUncertaintyPlanes);
        config.planes.used = matches!(self, Self::CnnPlanes | Self::CnnUncertaintyPlanes);
        // Planes that are only shown cost time.
        config.planes.find = config.planes.used;
        config
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_files_and_lead_back() {
        for variant in Variant::ALL {
            assert_eq!(Variant::from_name(variant.name()), Some(variant));
            assert_eq!(serde_json::to_value(variant).unwrap(), variant.name());
        }
        assert_eq!(Variant::from_name("cnn+p+u"), None);
    }

    #[test]
    fn no_two_variants_compute_the_same() {
        let configs = Variant::ALL.map(|variant| variant.applied_to(&Config::default(), "indoor"));
        for (index, config) in configs.iter().enumerate() {
            assert!(configs.iter().skip(index + 1).all(|other| other != config), "{index}");
            assert!(config.check().is_ok());
        }
        assert!(configs[0].depth.source == "none" && configs[0].planes.finder().is_none());
    }
}
