//! Curves over time, as SVG that stretches with the page; numbers on the axes are text of the page and keep their size.

use std::fmt::Write as _;

use super::html::{coordinate, escape, number};
use super::verdict::Stretch;

/// Size of the drawing in its own units.
const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 300.0;
/// Pieces that a curve is cut into; of each the least and the greatest value are drawn.
const PIECES: usize = 450;

/// Values over time.
pub(super) type Points = Vec<(f64, f64)>;

/// A curve.
#[derive(Debug, Clone, Default)]
pub(super) struct Line {
    pub name: String,
    /// Class of its colour.
    pub class: String,
    pub points: Points,
    /// Lower and upper edge of what is shaded around it, of the same class.
    pub area: Option<(Points, Points)>,
}

/// A chart.
#[derive(Debug, Clone, Default)]
pub(super) struct Chart<'a> {
    pub id: &'a str,
    pub title: &'a str,
    pub unit: &'a str,
    pub note: String,
    pub seconds: f64,
    pub lines: Vec<Line>,
    /// A range that values ought to lie in, shaded.
    pub expected: Option<(f64, f64)>,
    pub is_log: bool,
    /// Whether the axis begins at zero.
    pub from_zero: bool,
    /// A longer pause between values breaks a curve, s.
    pub gap_s: f64,
    /// Times of trouble are shaded.
    pub stretches: &'a [Stretch],
}

impl Chart<'_> {
    /// The chart as a figure; empty where it has no value to show.
    pub fn html(&self) -> String {
        let Some((low, high)) = self.range() else { return String::new() };
        let span = self.seconds.max(1e-6);
        let at = |(t, value): (f64, f64)| (WIDTH * t / span, HEIGHT * (1.0 - self.share(value, low, high)));
        let mut svg = String::new();
        for stretch in self.stretches.iter().filter(|stretch| stretch.state != "tracking") {
            let (from, width) = (WIDTH * stretch.from_s / span, WIDTH * (stretch.to_s - stretch.from_s) / span);
            let _ =
                write!(svg, "<rect class=\"h-{}\" x=\"{from:.1}\" y=\"0\" width=\"{:.1}\" height=\"300\"/>", stretch.state, width.max(2.0));
        }
        if let Some((from, to)) = self.expected {
            let (_, top) = at((0.0, to));
            let (_, bottom) = at((0.0, from));
            let (top, bottom) = (top.clamp(0.0, HEIGHT), bottom.clamp(0.0, HEIGHT));
            let _ =
                write!(svg, "<rect class=\"expected\" x=\"0\" y=\"{top:.1}\" width=\"1000\" height=\"{:.1}\"/>", (bottom - top).max(0.0));
        }
        let (values, times) = (self.ticks(low, high), round_steps(0.0, span, 6));
        let mut grid = String::new();
        for value in &values {
            let _ = write!(grid, "M0 {:.1}H1000", at((0.0, *value)).1);
        }
        for time in &times {
            let _ = write!(grid, "M{:.1} 0V300", at((*time, low)).0);
        }
        let _ = write!(svg, "<path class=\"grid\" d=\"{grid}\"/>");
        for line in &self.lines {
            if let Some((lower, upper)) = &line.area {
                let (lower, upper) = (thinned(lower, span, false), thinned(upper, span, true));
                // Edges may be given at fewer times than the curve, which is why their pauses may be longer.
                let pause = (4.0 * self.gap_s).max(2.2 * span / PIECES as f64);
                let near = |a: &(f64, f64), b: &(f64, f64)| b.0 - a.0 <= pause;
                let mut d = String::new();
                for (lower, upper) in lower.chunk_by(near).zip(upper.chunk_by(near)) {
                    let outline: Vec<_> = upper.iter().chain(lower.iter().rev()).map(|point| at(*point)).collect();
                    d += &closed(&outline);
                }
                let _ = write!(svg, "<path class=\"area {}\" d=\"{d}\"/>", line.class);
            }
        }
        for line in self.lines.iter().filter(|line| !line.points.is_empty()) {
            let points: Vec<_> = extremes(&line.points, span).into_iter().map(at).collect();
            let d = path(&points, WIDTH * self.gap_s.max(2.2 * span / PIECES as f64) / span);
            let _ = write!(svg, "<path class=\"line {}\" data-name=\"{}\" d=\"{d}\"/>", line.class, escape(&line.name));
        }
        let mut labels = String::new();
        for value in &values {
            let share = 100.0 * self.share(*value, low, high);
            let _ = write!(labels, "<span class=\"y\" style=\"bottom:{share:.1}%\">{}</span>", tick(*value, &values, self.is_log));
        }
        for (index, time) in times.iter().enumerate() {
            let unit = if index + 1 == times.len() { " s" } else { "" };
            let _ =
                write!(labels, "<span class=\"x\" style=\"left:{:.1}%\">{}{unit}</span>", 100.0 * time / span, tick(*time, &times, false));
        }
        let keys: String = self
            .lines
            .iter()
            .filter(|line| !line.name.is_empty())
            .map(|line| format!("<span class=\"key {}\"><i></i>{}</span>", line.class, escape(&line.name)))
            .collect();
        let note = if self.note.is_empty() { String::new() } else { format!("<p class=\"note\">{}</p>", escape(&self.note)) };
        format!(
            "<figure class=\"chart\" id=\"{id}\"><figcaption><b>{title}</b> <span class=\"unit\">{unit}</span> \
             <span class=\"keys\">{keys}</span><output class=\"readout\"></output></figcaption>\
             <div class=\"plot\" data-span=\"{span}\" data-low=\"{low}\" data-high=\"{high}\" data-log=\"{log}\">\
             <svg viewBox=\"0 0 1000 300\" preserveAspectRatio=\"none\" role=\"img\" aria-label=\"{title}, {unit}, over time\">{svg}</svg>\
             {labels}<div class=\"cursor\"></div></div>{note}</figure>",
            id = self.id,
            title = escape(self.title),
            unit = escape(self.unit),
            log = u8::from(self.is_log),
        )
    }

    fn range(&self) -> Option<(f64, f64)> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for line in &self.lines {
            let edges = line.area.iter().flat_map(|(lower, upper)| lower.iter().chain(upper));
            for (_, value) in line.points.iter().chain(edges).filter(|(_, value)| value.is_finite() && (!self.is_log || *value > 0.0)) {
                (low, high) = (low.min(*value), high.max(*value));
            }
        }
        if low > high {
            return None;
        }
        if let Some((from, to)) = self.expected {
            (low, high) = (low.min(from), high.max(to));
        }
        if self.is_log {
            // At least a decade, and no more than four.
            let high = high.max(low * 10.0);
            return Some(((low / 1.3).max(high * 1e-4), high * 1.3));
        }
        if self.from_zero {
            return Some((0.0, if high > 0.0 { high * 1.08 } else { 1.0 }));
        }
        let margin = 0.08 * (high - low).max(1e-3 * high.abs()).max(1e-9);
        Some((low - margin, high + margin))
    }

    fn share(&self, value: f64, low: f64, high: f64) -> f64 {
        let share = if self.is_log { (value.max(1e-300) / low).ln() / (high / low).ln() } else { (value - low) / (high - low) };
        share.clamp(0.0, 1.0)
    }

    fn ticks(&self, low: f64, high: f64) -> Vec<f64> {
        if !self.is_log {
            return round_steps(low, high, 4);
        }
        #[allow(clippy::cast_possible_truncation)]
        let decades = low.log10().ceil() as i32..=high.log10().floor() as i32;
        decades.map(|decade| 10.0_f64.powi(decade)).collect()
    }
}

/// Round numbers within a range, about so many.
pub(super) fn round_steps(low: f64, high: f64, about: usize) -> Vec<f64> {
    let rough = (high - low) / about.max(1) as f64;
    if !(rough > 0.0 && rough.is_finite()) {
        return Vec::new();
    }
    let decade = 10.0_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|factor| factor * decade).find(|step| *step >= rough).unwrap_or(decade);
    let first = (low / step - 1e-9).ceil();
    (0..64).map(|index| (first + f64::from(index)) * step).take_while(|value| *value <= high + 1e-9 * step).collect()
}

/// A number on an axis, with as many digits as its neighbours need.
pub(super) fn tick(value: f64, all: &[f64], is_log: bool) -> String {
    if is_log {
        let shown = number(value);
        // Powers of ten: 0.1, not 0.10.
        return if shown.contains('.') { shown.trim_end_matches('0').trim_end_matches('.').to_owned() } else { shown };
    }
    let step = all.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    if !step.is_finite() {
        return number(value);
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let digits = (-(step * 1.001).log10().floor()).max(0.0) as usize;
    let shown = format!("{:.digits$}", value);
    if shown.trim_start_matches('-').trim_matches(['0', '.']).is_empty() { "0".into() } else { shown }
}

/// The least and the greatest value of every piece of time, in order.
fn extremes(points: &[(f64, f64)], span: f64) -> Points {
    if points.len() <= 2 * PIECES {
        return points.to_vec();
    }
    let mut kept = Points::new();
    for piece in pieces(points, span) {
        let least = piece.iter().enumerate().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let most = piece.iter().enumerate().max_by(|a, b| a.1.1.total_cmp(&b.1.1));
        let (Some((first, a)), Some((second, b))) = (least, most) else { continue };
        match first.cmp(&second) {
            std::cmp::Ordering::Less => kept.extend([*a, *b]),
            std::cmp::Ordering::Greater => kept.extend([*b, *a]),
            std::cmp::Ordering::Equal => kept.push(*a),
        }
    }
    kept
}

/// One value per piece of time: the greatest, or the least.
fn thinned(points: &[(f64, f64)], span: f64, greatest: bool) -> Points {
    let better = |a: &&(f64, f64), b: &&(f64, f64)| if greatest { a.1.total_cmp(&b.1) } else { b.1.total_cmp(&a.1) };
    pieces(points, span).filter_map(|piece| Some((piece.first()?.0, piece.iter().max_by(better)?.1))).collect()
}

fn pieces(points: &[(f64, f64)], span: f64) -> impl Iterator<Item = &[(f64, f64)]> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let piece_of = move |point: &(f64, f64)| (point.0.max(0.0) / span * PIECES as f64) as usize;
    points.chunk_by(move |a, b| piece_of(a) == piece_of(b))
}

/// Around points in the drawing's units.
pub(super) fn closed(points: &[(f64, f64)]) -> String {
    joined(points) + "Z"
}

/// Through all points, without a break.
pub(super) fn joined(points: &[(f64, f64)]) -> String {
    let mut d = String::with_capacity(points.len() * 12);
    for (index, (x, y)) in points.iter().enumerate() {
        d.push(if index == 0 { 'M' } else { 'L' });
        coordinate(&mut d, *x);
        d.push(' ');
        coordinate(&mut d, *y);
    }
    d
}

/// Through points in the drawing's units, broken where they are farther apart than `gap`.
pub(super) fn path(points: &[(f64, f64)], gap: f64) -> String {
    let mut d = String::with_capacity(points.len() * 12);
    let mut before = f64::NEG_INFINITY;
    for (x, y) in points.iter().filter(|(x, y)| x.is_finite() && y.is_finite()) {
        d.push(if before.is_finite() && x - before <= gap { 'L' } else { 'M' });
        coordinate(&mut d, *x);
        d.push(' ');
        coordinate(&mut d, *y);
        before = *x;
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        assert_eq!(round_steps(0.0, 17.0, 6), [0.0, 5.0, 10.0, 15.0]);
        let steps = round_steps(-0.013, 0.031, 4);
        assert_eq!(steps.iter().map(|value| tick(*value, &steps, false)).collect::<Vec<_>>(), ["0", "0.02"]);
        assert_eq!(round_steps(1.0, 1.0, 4), [0.0; 0]);
        assert_eq!([0.1, 1.0, 10.0, 100.0].map(|value| tick(value, &[], true)), ["0.1", "1", "10", "100"]);
    }

    #[test]
    fn a_spike_survives_thinning_and_a_pause_breaks_the_curve() {
        let mut points: Points = (0..20_000).map(|index| (f64::from(index) * 0.01, 1.0)).collect();
        points[12_345].1 = 9.0;
        let kept = extremes(&points, 200.0);
        assert!(kept.len() <= 2 * PIECES + 2 && kept.contains(&(123.45, 9.0)));
        assert_eq!(path(&[(0.0, 1.0), (1.0, 2.0), (9.0, -0.01)], 2.0), "M0 1L1 2M9 0");
    }
}
