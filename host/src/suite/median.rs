//! Medians over runs some of which gave nothing.

/// The median, where a run that gave nothing counts as worse than any number; `None` where the median is such a run, or there is none.
pub(super) fn median(values: &[Option<f64>]) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().map(|value| value.unwrap_or(f64::INFINITY)).collect();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    let lower = if sorted.len().is_multiple_of(2) { *sorted.get((sorted.len() / 2).checked_sub(1)?)? } else { upper };
    Some(0.5 * (lower + upper)).filter(|value| value.is_finite())
}

/// The mean; `None` where one is missing, or there is none.
pub(super) fn mean(values: &[Option<f64>]) -> Option<f64> {
    let all: Option<Vec<f64>> = values.iter().copied().collect();
    let all = all.filter(|all| !all.is_empty())?;
    Some(all.iter().sum::<f64>() / all.len() as f64)
}

/// Smallest and largest; `None` where one is missing, or there is none.
pub(super) fn extent(values: &[Option<f64>]) -> Option<(f64, f64)> {
    let all: Vec<f64> = values.iter().copied().collect::<Option<_>>()?;
    let first = *all.first()?;
    Some(all.iter().fold((first, first), |(low, high), value| (low.min(*value), high.max(*value))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_run_is_worse_than_any_other() {
        assert_eq!(median(&[Some(3.0), Some(1.0), Some(2.0)]), Some(2.0));
        assert_eq!(median(&[Some(3.0), Some(1.0), None]), Some(3.0));
        assert_eq!(median(&[Some(3.0), None, None]), None);
        assert_eq!(median(&[Some(3.0), Some(1.0)]), Some(2.0));
        // Half of two is lost: no number is the middle.
        assert_eq!(median(&[Some(3.0), None]), None);
        assert_eq!(median(&[]), None);
    }

    #[test]
    fn mean_and_extent_need_every_value() {
        assert_eq!(mean(&[Some(1.0), Some(2.0)]), Some(1.5));
        assert_eq!(extent(&[Some(2.0), Some(1.0), Some(1.5)]), Some((1.0, 2.0)));
        assert_eq!((mean(&[Some(1.0), None]), mean(&[]), extent(&[None]), extent(&[])), (None, None, None, None));
    }
}
