//! Points in a plane with both axes: a logarithmic one below, a linear one at the left.

use maud::{Markup, html};

use crate::format::number;
use crate::plot::{HEIGHT, WIDTH, number_short, ticks};

/// A point with what is said of it.
#[derive(Clone, Debug)]
pub struct Point {
    /// Along the logarithmic axis; points that are not above 0 are left out.
    pub x: f64,
    /// Along the linear axis.
    pub y: f64,
    /// Beside the point.
    pub label: String,
    /// `device` for the series, `marked` for a point that is shown apart.
    pub class: &'static str,
}

/// A chart of points.
#[derive(Clone, Debug)]
pub struct Scatter {
    /// Said aloud in place of the drawing.
    pub label: String,
    /// Title of the logarithmic axis, with its unit.
    pub x_title: String,
    /// Title of the linear axis, with its unit.
    pub y_title: String,
    /// The points; those of the series are joined in their order along x.
    pub points: Vec<Point>,
}

impl Scatter {
    /// The chart; a sentence where no point can be shown.
    #[must_use]
    pub fn markup(&self) -> Markup {
        let shown = |point: &&Point| point.x > 0.0 && point.x.is_finite() && point.y.is_finite();
        let points: Vec<&Point> = self.points.iter().filter(shown).collect();
        if points.is_empty() {
            return html! { p.muted { "There is nothing to show." } };
        }
        let logs = || points.iter().map(|point| libm::log10(point.x));
        // A twentieth of a decade beside the outermost points.
        let low = logs().fold(f64::INFINITY, f64::min) - 0.08;
        let high = logs().fold(f64::NEG_INFINITY, f64::max) + 0.08;
        let least = points
            .iter()
            .map(|point| point.y)
            .fold(f64::INFINITY, f64::min);
        let most = points
            .iter()
            .map(|point| point.y)
            .fold(f64::NEG_INFINITY, f64::max);
        let margin = (0.1 * (most - least)).max(0.05 * most.abs()).max(1e-9);
        let (bottom, top) = (least - margin, most + margin);
        let x = |value: f64| 100.0 * (libm::log10(value) - low) / (high - low);
        let y = |value: f64| 100.0 * (1.0 - (value - bottom) / (top - bottom));
        let mut series: Vec<&&Point> = points
            .iter()
            .filter(|point| point.class == "device")
            .collect();
        series.sort_by(|a, b| a.x.total_cmp(&b.x));
        let path: Vec<String> = series
            .iter()
            .map(|point| {
                let (at_x, at_y) = (x(point.x) * WIDTH / 100.0, y(point.y) * HEIGHT / 100.0);
                format!("{at_x:.1} {at_y:.2}")
            })
            .collect();
        let marks = decades(low, high);
        html! {
            p.axis-title { (self.y_title) }
            div.plot style="--height:280px" {
                div.y-axis aria-hidden="true" {
                    @for tick in ticks(bottom, top, 6) {
                        span style=(format!("top:{:.2}%", y(tick))) { (number_short(tick)) }
                    }
                }
                div.scatter role="img" aria-label=(self.label) {
                    svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) preserveAspectRatio="none" aria-hidden="true" {
                        @for tick in ticks(bottom, top, 6) {
                            path.grid d=(format!("M0 {:.2}H{WIDTH}", y(tick) * HEIGHT / 100.0)) {}
                        }
                        @for mark in &marks {
                            path.grid d=(format!("M{:.1} 0V{HEIGHT}", x(*mark) * WIDTH / 100.0)) {}
                        }
                        @if path.len() > 1 { path.device d=(format!("M{}", path.join("L"))) {} }
                    }
                    @for point in &points {
                        i class=(point.class) title=(point.label)
                            style=(format!("left:{:.2}%;top:{:.2}%", x(point.x), y(point.y))) {}
                        // Beside the point, on the side where there is room.
                        span class=(point.class) .before[x(point.x) > 70.0]
                            style=(format!("left:{:.2}%;top:{:.2}%", x(point.x), y(point.y))) {
                            (point.label)
                        }
                    }
                }
                div.x-axis.marks aria-hidden="true" {
                    @for mark in &marks {
                        span style=(format!("left:{:.2}%", x(*mark))) { (number(*mark)) }
                    }
                }
            }
            p.axis-title.below { (self.x_title) }
        }
    }
}

/// 1, 2 and 5 times the powers of ten between two logarithms.
fn decades(low: f64, high: f64) -> Vec<f64> {
    let (from, to) = (libm::floor(low) as i32, libm::ceil(high) as i32);
    let factors: &[f64] = if to - from > 4 {
        &[1.0]
    } else {
        &[1.0, 2.0, 5.0]
    };
    let all = (from..=to).flat_map(|exponent| {
        let power = libm::pow(10.0, f64::from(exponent));
        factors.iter().map(move |factor| factor * power)
    });
    all.filter(|mark| (low..=high).contains(&libm::log10(*mark)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_axes_have_marks_and_every_point_its_label() {
        let point = |x, y, class| Point {
            x,
            y,
            label: format!("{y} bits"),
            class,
        };
        let chart = Scatter {
            label: "front".into(),
            x_title: "error in degrees".into(),
            y_title: "bits".into(),
            points: vec![
                point(0.01, 1040.0, "device"),
                point(0.1, 900.0, "device"),
                point(0.004, 1360.0, "marked"),
            ],
        };
        let text = chart.markup().into_string();
        for expected in [
            "error in degrees",
            "1360 bits",
            "900 bits",
            ">0.0100<",
            ">0.100<",
            ">1000<",
        ] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        let none = Scatter {
            points: vec![point(0.0, 1.0, "device")],
            ..chart
        };
        assert!(none.markup().into_string().contains("nothing to show"));
    }
}
