//! Named capacities.

use crate::estimator::Estimator;

/// Workstation: 752×480, the budget is 8 MiB in `f64`.
pub type Desktop<T> = Estimator<T, 12, 78, 400, 4096>;
