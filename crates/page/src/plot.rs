//! Curves over time, and bars on a logarithmic scale.
//!
//! The drawing stretches with the page while line widths and labels do not: curves are an SVG
//! without text, labels are HTML placed by percentages.

use std::fmt::Write;

use maud::{Markup, html};

use crate::format::number;

/// A drawing's inner coordinates.
pub(crate) const WIDTH: f64 = 1000.0;
pub(crate) const HEIGHT: f64 = 100.0;

/// What is drawn, from back to front.
#[derive(Clone, Debug)]
pub enum Layer {
    /// A polyline that is interrupted where it jumps by `jump` or more.
    Line {
        /// Class in the style sheet.
        class: &'static str,
        /// Time and value.
        points: Vec<(f64, f64)>,
        /// Jump that interrupts the line.
        jump: f64,
    },
    /// The area between the smallest and the largest value in each stretch of time.
    Band {
        /// Class in the style sheet.
        class: &'static str,
        /// Extremes per stretch.
        stretches: Vec<Option<Stretch>>,
    },
    /// A horizontal dashed line.
    Level {
        /// Class in the style sheet.
        class: &'static str,
        /// Value.
        at: f64,
    },
    /// Vertical stripes: stretches of time in which something held.
    Shade {
        /// Class in the style sheet.
        class: &'static str,
        /// From and to.
        spans: Vec<(f64, f64)>,
    },
}

/// Smallest and largest value in a stretch of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// Its middle.
    pub time: f64,
    /// Smallest value.
    pub low: f64,
    /// Largest value.
    pub high: f64,
}

/// A curve over time.
#[derive(Clone, Debug)]
pub struct Plot {
    /// Said aloud in place of the drawing.
    pub label: String,
    /// Length of the horizontal axis.
    pub seconds: f64,
    /// Lower end of the vertical axis.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// Where the vertical axis is marked.
    pub ticks: Vec<f64>,
    /// Unit of the vertical axis, after the topmost mark.
    pub unit: String,
    /// Height in pixels.
    pub height: u32,
    /// What is drawn, from back to front.
    pub layers: Vec<Layer>,
}

impl Plot {
    fn x(&self, time: f64) -> f64 {
        WIDTH * time / self.seconds
    }

    fn y(&self, value: f64) -> f64 {
        let part = (value - self.low) / (self.high - self.low);
        HEIGHT * (1.0 - part.clamp(-0.1, 1.1))
    }

    /// The chart.
    #[must_use]
    pub fn markup(&self) -> Markup {
        let view = format!("0 0 {WIDTH} {HEIGHT}");
        let times = ticks(0.0, self.seconds, 6);
        let last = times.last().copied();
        html! {
            div.plot style=(format!("--height:{}px", self.height)) {
                div.y-axis aria-hidden="true" {
                    @for (index, tick) in self.ticks.iter().enumerate() {
                        span style=(format!("top:{:.2}%", self.y(*tick))) {
                            (number_short(*tick))
                            @if index + 1 == self.ticks.len() { (self.unit) }
                        }
                    }
                }
                svg viewBox=(view) preserveAspectRatio="none" role="img" aria-label=(self.label) {
                    @for tick in &self.ticks {
                        path.grid d=(level(self.y(*tick))) {}
                    }
                    @for layer in &self.layers { (self.layer(layer)) }
                }
                div.x-axis aria-hidden="true" {
                    @for tick in &times {
                        span style=(format!("left:{:.2}%", self.x(*tick) / WIDTH * 100.0)) {
                            (number_short(*tick))
                            @if Some(*tick) == last { " s" }
                        }
                    }
                }
            }
        }
    }

    fn layer(&self, layer: &Layer) -> Markup {
        match layer {
            Layer::Line {
                class,
                points,
                jump,
            } => html! { path class=(class) d=(self.polyline(points, *jump)) {} },
            Layer::Band { class, stretches } => {
                html! { path class=(class) d=(self.band(stretches)) {} }
            }
            Layer::Level { class, at } => html! { path class=(class) d=(level(self.y(*at))) {} },
            Layer::Shade { class, spans } => html! {
                @for (from, to) in spans {
                    rect class=(class) x=(format!("{:.1}", self.x(*from))) y="0"
                        width=(format!("{:.1}", self.x(to - from))) height=(HEIGHT) {}
                }
            },
        }
    }

    fn polyline(&self, points: &[(f64, f64)], jump: f64) -> String {
        let mut path = String::new();
        let mut before: Option<f64> = None;
        for &(time, value) in points {
            let joined = before.is_some_and(|before| (value - before).abs() < jump);
            self.point(&mut path, if joined { 'L' } else { 'M' }, time, value);
            before = Some(value);
        }
        path
    }

    /// Each unbroken run of stretches: along the upper edge, back along the lower.
    fn band(&self, stretches: &[Option<Stretch>]) -> String {
        let mut path = String::new();
        for run in stretches.split(Option::is_none) {
            let run: Vec<Stretch> = run.iter().copied().flatten().collect();
            let upper = run.iter().map(|at| (at.time, at.high));
            let lower = run.iter().rev().map(|at| (at.time, at.low));
            for (index, (time, value)) in upper.chain(lower).enumerate() {
                self.point(&mut path, if index == 0 { 'M' } else { 'L' }, time, value);
            }
            if !run.is_empty() {
                path.push('Z');
            }
        }
        path
    }

    fn point(&self, path: &mut String, command: char, time: f64, value: f64) {
        let _ = write!(path, "{command}{:.1} {:.2}", self.x(time), self.y(value));
    }
}

fn level(y: f64) -> String {
    format!("M0 {y:.2}H{WIDTH}")
}

/// Values at equal steps of time, of which the extremes over stretches are kept: at most twice as many as asked
/// for, however many values come.
#[derive(Clone, Debug, Default)]
pub struct Envelope {
    most: usize,
    /// Values per stretch; 0 as long as there is none.
    size: usize,
    count: usize,
    stretches: Vec<Option<Extremes>>,
}

/// First value and extremes of a stretch.
#[derive(Clone, Copy, Debug)]
struct Extremes {
    first: f64,
    low: f64,
    high: f64,
}

impl Extremes {
    fn with(self, later: Self) -> Self {
        Self {
            first: self.first,
            low: self.low.min(later.low),
            high: self.high.max(later.high),
        }
    }
}

impl Envelope {
    /// Keeps at least `most` stretches, where there are as many values.
    #[must_use]
    pub fn new(most: usize) -> Self {
        Self {
            most: most.max(1),
            ..Self::default()
        }
    }

    /// Adds the next value; `None`, or what is not finite, is a gap.
    pub fn push(&mut self, value: Option<f64>) {
        let size = self.size.max(1);
        if self.count == self.stretches.len() * size {
            if self.stretches.len() >= 2 * self.most.max(1) {
                self.halve();
            }
            if self.count == self.stretches.len() * self.size.max(1) {
                self.stretches.push(None);
            }
        }
        self.size = self.size.max(1);
        self.count += 1;
        let value = value.filter(|value| value.is_finite());
        let found = value.map(|value| Extremes {
            first: value,
            low: value,
            high: value,
        });
        if let Some(last) = self.stretches.last_mut() {
            *last = joined(*last, found);
        }
    }

    fn halve(&mut self) {
        let pairs = self.stretches.chunks(2);
        let pairs = pairs.map(|pair| joined(pair[0], pair.get(1).copied().flatten()));
        self.stretches = pairs.collect();
        self.size *= 2;
    }

    /// Values so far, gaps among them.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there was no value.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Whether a stretch holds one value only, so that nothing is left out.
    #[must_use]
    pub const fn is_whole(&self) -> bool {
        self.size <= 1
    }

    /// Times of the stretches' middles, values `step_s` seconds apart.
    fn timed(&self, step_s: f64) -> impl Iterator<Item = (f64, Option<Extremes>)> + '_ {
        let size = self.size.max(1) as f64;
        let stretches = self.stretches.iter().enumerate();
        stretches.map(move |(index, found)| ((index as f64 + 0.5) * size * step_s, *found))
    }

    /// The extremes of each stretch, values `step_s` seconds apart.
    #[must_use]
    pub fn stretches(&self, step_s: f64) -> Vec<Option<Stretch>> {
        let stretch = |(time, found): (f64, Option<Extremes>)| {
            found.map(|found| Stretch {
                time,
                low: found.low,
                high: found.high,
            })
        };
        self.timed(step_s).map(stretch).collect()
    }

    /// The first value of each stretch and its time.
    #[must_use]
    pub fn points(&self, step_s: f64) -> Vec<(f64, f64)> {
        let points = self.timed(step_s);
        points
            .filter_map(|(time, found)| Some((time, found?.first)))
            .collect()
    }

    /// Spans of time in which any value is above 0, to within a stretch.
    #[must_use]
    pub fn spans(&self, step_s: f64) -> Vec<(f64, f64)> {
        let length = self.size.max(1) as f64 * step_s;
        let edge = |index: usize| index as f64 * length;
        let hits = self.stretches.iter();
        let hits = hits.map(|found| found.is_some_and(|found| found.high > 0.0));
        let (mut spans, mut start) = (Vec::new(), None);
        for (index, hit) in hits.chain([false]).enumerate() {
            match (start, hit) {
                (None, true) => start = Some(index),
                (Some(from), false) => {
                    spans.push((edge(from), edge(index)));
                    start = None;
                }
                _ => {}
            }
        }
        spans
    }

    /// Largest absolute value.
    #[must_use]
    pub fn most(&self) -> f64 {
        let known = self.stretches.iter().flatten();
        known.fold(0f64, |most, at| most.max(at.high.abs()).max(at.low.abs()))
    }
}

fn joined(earlier: Option<Extremes>, later: Option<Extremes>) -> Option<Extremes> {
    match (earlier, later) {
        (Some(earlier), Some(later)) => Some(earlier.with(later)),
        (found, None) | (None, found) => found,
    }
}

/// Round numbers that cover low..=high, about `about` of them.
#[must_use]
pub fn ticks(low: f64, high: f64, about: usize) -> Vec<f64> {
    let span = high - low;
    if span.is_nan() || span <= 0.0 || !span.is_finite() {
        return vec![low];
    }
    let rough = span / about as f64;
    let decade = libm::pow(10.0, libm::floor(libm::log10(rough)));
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * decade)
        .into_iter()
        .find(|step| *step >= rough)
        .unwrap_or(10.0 * decade);
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|index| index as f64 * step).collect()
}

/// A mark's label: no more digits than it needs.
pub(crate) fn number_short(value: f64) -> String {
    let text = number(value);
    if text.contains('.') && !text.contains('e') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A bar's name, its size (`None`: not in this run), and a remark.
#[derive(Clone, Debug)]
pub struct Bar {
    /// Its name.
    pub name: String,
    /// A remark below it.
    pub remark: String,
    /// Its size.
    pub size: Option<f64>,
    /// Class in the style sheet.
    pub class: &'static str,
}

/// Bars on a logarithmic scale with a mark at each decade; zero has no bar.
#[must_use]
pub fn bars(bars: &[Bar], unit: &str) -> Markup {
    let sizes = || {
        let known = bars.iter().filter_map(|bar| bar.size);
        known.filter(|size| size.is_finite() && *size > 0.0)
    };
    let smallest = sizes().fold(f64::INFINITY, f64::min);
    let largest = sizes().fold(0.0, f64::max);
    let (from, to) = if largest > 0.0 {
        let from = libm::floor(libm::log10(smallest)) as i32;
        (
            from,
            (libm::ceil(libm::log10(largest)) as i32).max(from + 1),
        )
    } else {
        (-1, 0)
    };
    let place = |decade: f64| 100.0 * (decade - f64::from(from)) / f64::from(to - from);
    html! {
        div.bars {
            @for bar in bars {
                div.bar {
                    div.name { (bar.name) @if !bar.remark.is_empty() { small { (bar.remark) } } }
                    div.track {
                        @for decade in from..=to {
                            i style=(format!("left:{:.2}%", place(f64::from(decade)))) {}
                        }
                        @if let Some(size) = bar.size.filter(|size| *size > 0.0) {
                            b class=(bar.class)
                                style=(format!("width:{:.2}%", place(libm::log10(size)).max(0.4))) {}
                        }
                    }
                    div.value {
                        @match bar.size {
                            Some(size) if size == 0.0 => "0",
                            Some(size) => { (number(size)) (unit) },
                            None => span.muted { "not in this run" },
                        }
                    }
                }
            }
            div.bar aria-hidden="true" {
                div.decades {
                    @for decade in from..=to {
                        span style=(format!("left:{:.2}%", place(f64::from(decade)))) {
                            "10" sup { (decade) }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let close = |left: &[f64], right: &[f64]| {
            left.len() == right.len() && left.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-12)
        };
        assert!(close(
            &ticks(0.0, 10.0, 6),
            &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
        ));
        assert!(close(&ticks(-0.3, 0.3, 3), &[-0.2, 0.0, 0.2]));
        assert!(close(&ticks(1.0, 1.0, 3), &[1.0]));
    }

    #[test]
    fn a_stretch_keeps_the_extremes_and_a_gap_stays_a_gap() {
        let mut found = Envelope::new(2);
        for value in [3.0, -1.0, f64::NAN, f64::NAN, 7.0, 5.0, 6.0, 8.0] {
            found.push(Some(value));
        }
        assert_eq!(found.len(), 8);
        let extremes: Vec<_> = found
            .stretches(1.0)
            .into_iter()
            .map(|at| at.map(|at| (at.time, at.low, at.high)))
            .collect();
        let expected = [
            Some((1.0, -1.0, 3.0)),
            None,
            Some((5.0, 5.0, 7.0)),
            Some((7.0, 6.0, 8.0)),
        ];
        assert_eq!(extremes, expected);
        assert_eq!(found.points(1.0), [(1.0, 3.0), (5.0, 7.0), (7.0, 6.0)]);
        assert_eq!(found.most(), 8.0);
    }

    #[test]
    fn no_value_is_lost_however_many_come() {
        let mut found = Envelope::new(10);
        for at in 0..12_345 {
            found.push(Some(f64::from(at * 7919 % 12_345)));
        }
        let stretches = found.stretches(0.5);
        assert!((10..=20).contains(&stretches.len()), "{}", stretches.len());
        let known = || stretches.iter().flatten();
        assert_eq!(known().map(|at| at.high).fold(0.0, f64::max), 12_344.0);
        assert_eq!(known().map(|at| at.low).fold(1e9, f64::min), 0.0);
        assert!(!found.is_whole());
    }

    #[test]
    fn spans_join_neighbours_and_keep_single_solutions_visible() {
        let spans = |most: usize| {
            let mut found = Envelope::new(most);
            for solution in 0..100 {
                let is_set = solution == 10 || (50..60).contains(&solution);
                found.push(Some(f64::from(u8::from(is_set))));
            }
            found.spans(1.0)
        };
        assert_eq!(spans(100), [(10.0, 11.0), (50.0, 60.0)]);
        assert_eq!(spans(25), [(10.0, 12.0), (50.0, 60.0)]);
        assert_eq!(Envelope::new(10).spans(1.0), []);
    }
}
