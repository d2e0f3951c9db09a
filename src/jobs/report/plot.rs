//! Drawings of costs against errors as SVG, in the colours of the page.

use std::fmt::Write;

use crate::text::html;

/// A point of a drawing.
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) label: String,
    /// True for the default choice.
    pub(super) usual: bool,
    pub(super) on_front: bool,
}

/// Points of one subject.
pub(super) struct Series {
    pub(super) name: String,
    pub(super) points: Vec<Point>,
}

/// Sides of a drawing, and of what lies around its frame: left, top, right, bottom.
const SIZE: [f64; 2] = [720.0, 380.0];
const MARGIN: [f64; 4] = [74.0, 16.0, 24.0, 52.0];
/// Colours of the page that series take in turn.
const COLOURS: usize = 7;
/// Least distance of two labels, up or down, and about the width of one of their characters.
const LABEL: f64 = 14.0;
const CHARACTER: f64 = 7.0;

/// An axis: logarithmic where all values are above 0 and differ much.
struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    fn new(values: &[f64]) -> Self {
        let (least, most) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let log = least > 0.0 && most > 5.0 * least;
        let (low, high) = if log {
            (least.log10() - 0.06, most.log10() + 0.06)
        } else {
            (0.0_f64.min(least), if most > 0.0 { 1.08 * most } else { 1.0 })
        };
        let least_room = 0.3;
        let missing = if log { (least_room - (high - low)).max(0.0) } else { 0.0 };
        Self { low: low - missing / 2.0, high: high + missing / 2.0, log }
    }

    /// 0 at the low end, 1 at the high one.
    fn part(&self, value: f64) -> f64 {
        let value = if self.log { value.log10() } else { value };
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }

    /// Values at which a line is drawn: 1, 2, 5 of every power of ten that they lie in.
    fn ticks(&self) -> Vec<f64> {
        if self.log {
            let mut all = Vec::new();
            let mut power = self.low.floor();
            while power <= self.high {
                all.extend([1.0, 2.0, 5.0].map(|m| m * 10_f64.powf(power)));
                power += 1.0;
            }
            all.retain(|v| (self.low..=self.high).contains(&v.log10()));
            if all.len() > 8 {
                all.retain(|v| (v.log10() - v.log10().round()).abs() < 1e-9);
            }
            return all;
        }
        let rough = (self.high - self.low) / 5.0;
        let power = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().find(|m| m * power >= rough).unwrap_or(10.0) * power;
        let mut all = Vec::new();
        let mut at = (self.low / step).ceil() * step;
        while at <= self.high && all.len() < 20 {
            all.push(at);
            at += step;
        }
        all
    }
}

/// A number as short as it can be read.
pub(super) fn short(value: f64) -> String {
    let size = value.abs();
    match size {
        _ if size == 0.0 => "0".into(),
        _ if size >= 1e9 => format!("{:.3}G", value / 1e9),
        _ if size >= 1e6 => format!("{:.3}M", value / 1e6),
        _ if size >= 1e4 => format!("{:.1}k", value / 1e3),
        _ if size >= 100.0 => format!("{value:.0}"),
        _ if size >= 1.0 => format!("{value:.2}"),
        _ if size >= 1e-3 => format!("{value:.4}"),
        _ => format!("{value:.1e}"),
    }
}

/// A tick: as short as it can be without being another number.
fn tick(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if size >= 1e9 => (value / 1e9, "G"),
        size if size >= 1e6 => (value / 1e6, "M"),
        size if size >= 1e4 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let text = format!("{scaled:.6}");
    let plain = text.trim_end_matches('0').trim_end_matches('.');
    format!("{}{unit}", if plain.is_empty() || plain == "-0" { "0" } else { plain })
}

/// The drawing, or nothing if fewer than two points have both coordinates.
pub(super) fn scatter(series: &[Series], x_title: &str, y_title: &str) -> Option<String> {
    let all = || series.iter().flat_map(|s| &s.points);
    if all().count() < 2 {
        return None;
    }
    let x_axis = Axis::new(&all().map(|p| p.x).collect::<Vec<_>>());
    let y_axis = Axis::new(&all().map(|p| p.y).collect::<Vec<_>>());
    let [left, top, right, bottom] = MARGIN;
    let (width, height) = (SIZE[0] - left - right, SIZE[1] - top - bottom);
    let x = |v: f64| left + width * x_axis.part(v);
    let y = |v: f64| top + height * (1.0 - y_axis.part(v));
    let mut svg = format!(
        "<svg viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{} against {}\">",
        SIZE[0],
        SIZE[1],
        html(y_title),
        html(x_title)
    );
    // Writing to a string cannot fail.
    for value in x_axis.ticks() {
        let at = x(value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{top}\" x2=\"{at:.1}\" y2=\"{:.1}\"/><text class=\"tick\" x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            top + height,
            top + height + 18.0,
            tick(value)
        );
    }
    for value in y_axis.ticks() {
        let at = y(value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{left}\" y1=\"{at:.1}\" x2=\"{:.1}\" y2=\"{at:.1}\"/><text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            left + width,
            left - 8.0,
            at + 4.0,
            tick(value)
        );
    }
    let _ = write!(
        svg,
        "<rect class=\"frame\" x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\"/><text class=\"axis\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text><text class=\"axis\" transform=\"translate(16 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        left + width / 2.0,
        SIZE[1] - 10.0,
        html(x_title),
        top + height / 2.0,
        html(y_title)
    );
    // Where labels stand already: from, to, and how high.
    let mut taken: Vec<[f64; 3]> = Vec::new();
    // With many series only points on a front, and defaults, are named.
    let is_crowded = series.len() > 3;
    for (i, series) in series.iter().enumerate() {
        let colour = i % COLOURS;
        let mut front: Vec<&Point> = series.points.iter().filter(|p| p.on_front).collect();
        crate::order::by(&mut front, |a, b| a.x.total_cmp(&b.x));
        if front.len() > 1 {
            let way: Vec<String> = front.iter().map(|p| format!("{:.1},{:.1}", x(p.x), y(p.y))).collect();
            let _ = write!(svg, "<polyline class=\"front c{colour}\" points=\"{}\"/>", way.join(" "));
        }
        for point in &series.points {
            let (px, py) = (x(point.x), y(point.y));
            let kind = if point.usual { "dot usual" } else { "dot" };
            let radius = if point.on_front { 5.0 } else { 3.5 };
            let _ = write!(
                svg,
                "<circle class=\"{kind} c{colour}\" cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"{radius}\"><title>{}, {}: {} at {}</title></circle>",
                html(&series.name),
                html(&point.label),
                short(point.y),
                short(point.x)
            );
            // Next to the point, on the side with room; left out where other labels or points are.
            let wide = CHARACTER * point.label.chars().count() as f64;
            let [before, after] = [(px - 9.0 - wide, px - 9.0, "end"), (px + 9.0, px + 9.0, "start")];
            let sides = if px > left + 0.72 * width { [before, after] } else { [after, before] };
            let meets =
                |from: f64, at: &[f64; 3]| at[0] < from + wide && from < at[1] && (at[2] - py).abs() < LABEL;
            let is_free = |(from, ..): &&(f64, f64, &str)| {
                let mut dots = all().map(|p| [x(p.x) - 5.0, x(p.x) + 5.0, y(p.y)]);
                *from > left
                    && from + wide < left + width + right
                    && !taken.iter().any(|at| meets(*from, at))
                    && !dots.any(|dot| meets(*from, &dot))
            };
            let is_named = !is_crowded || point.on_front || point.usual;
            if let Some((from, tx, anchor)) = sides.iter().find(is_free).filter(|_| is_named) {
                taken.push([*from, from + wide, py]);
                let _ = write!(
                    svg,
                    "<text class=\"label\" x=\"{tx:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
                    py + 4.0,
                    html(&point.label)
                );
            }
        }
    }
    svg.push_str("</svg>");
    Some(svg)
}

/// Colours of a drawing that stands alone: ink, soft, line, ground, and those of the series; for light pages and dark
/// ones. Written out, as not every viewer of drawings knows variables.
const LIGHT: [&str; 4 + COLOURS] = [
    "#1b1f24", "#5f6875", "#dde1e7", "#fff", "#1f6fb2", "#c2571a", "#2c8a4b", "#8a4bb0", "#b0353f",
    "#7a6a00", "#0f8a8a",
];
const DARK: [&str; 4 + COLOURS] = [
    "#e7eaee", "#9aa4b1", "#323943", "#1d2127", "#6cb2ee", "#f0a06a", "#78cf95", "#c79be8", "#ff8f95",
    "#d9c86a", "#6fd0d0",
];

/// The rules of a drawing that stands alone.
fn style() -> String {
    let of = |colours: [&str; 4 + COLOURS]| {
        let [ink, soft, line, ground, series @ ..] = colours;
        let mut rules = format!(
            ".ground,.dot{{fill:{ground}}}.grid{{stroke:{line}}}.frame{{stroke:{soft}}}.tick{{fill:{soft}}}.axis,.label,.name{{fill:{ink}}}"
        );
        for (i, colour) in series.iter().enumerate() {
            let _ = write!(rules, ".c{i}{{stroke:{colour}}}.usual.c{i}{{fill:{colour}}}");
        }
        rules
    };
    format!(
        "<style>svg{{font-family:system-ui,sans-serif}}.tick,.label,.name{{font-size:12px}}.axis{{font-size:13px}}.frame,.front{{fill:none}}.dot{{stroke-width:2}}.front{{stroke-width:1.5;stroke-dasharray:5 4;opacity:.75}}{}@media(prefers-color-scheme:dark){{{}}}</style>",
        of(LIGHT),
        of(DARK)
    )
}

/// A drawing as a file of its own, with the names of its series below it.
pub(super) fn standalone(svg: &str, names: &[&str]) -> String {
    let rows = names.len().div_ceil(KEYS_IN_A_ROW);
    let height = SIZE[1] + 20.0 * rows as f64 + 8.0;
    let width = SIZE[0];
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">{}<rect class=\"ground\" width=\"{width}\" height=\"{height}\"/>",
        style()
    );
    // The drawing's own head gives way to the file's.
    text.push_str(svg.split_once('>').map_or("", |(_, rest)| rest).trim_end_matches("</svg>"));
    for (i, name) in names.iter().enumerate() {
        let x = MARGIN[0] + (i % KEYS_IN_A_ROW) as f64 * 310.0;
        let y = SIZE[1] + 12.0 + 20.0 * (i / KEYS_IN_A_ROW) as f64;
        let _ = write!(
            text,
            "<circle class=\"dot usual c{}\" cx=\"{x:.0}\" cy=\"{:.0}\" r=\"4.5\"/><text class=\"name\" x=\"{:.0}\" y=\"{y:.0}\">{}</text>",
            i % COLOURS,
            y - 4.0,
            x + 10.0,
            html(name)
        );
    }
    text.push_str("</svg>\n");
    text
}

/// Names of series in a row below a drawing.
const KEYS_IN_A_ROW: usize = 2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_logarithmic_where_values_differ_much() {
        let axis = Axis::new(&[0.001, 10.0]);
        assert!(axis.log && axis.part(0.1) > 0.4 && axis.part(0.1) < 0.6);
        assert!(axis.ticks().len() <= 8 && axis.ticks().contains(&1.0));
        let plain = Axis::new(&[0.0, 10.0]);
        assert!(!plain.log && plain.part(0.0) == 0.0 && plain.ticks().contains(&5.0));
        // Nothing but zeros, or a single value, is drawn, too.
        assert!(Axis::new(&[0.0, 0.0]).part(0.0).is_finite() && Axis::new(&[3.0, 3.0]).ticks().len() > 1);
        assert_eq!(
            [0.0, 2.5, 1_234_567.0, 0.25, 1e-7].map(short),
            ["0", "2.50", "1.235M", "0.2500", "1.0e-7"]
        );
        assert_eq!([0.0, 2.5, 2e6, 0.25, 50_000.0].map(tick), ["0", "2.5", "2M", "0.25", "50k"]);
    }

    #[test]
    fn names_cannot_break_the_page() {
        let point = |x| Point { x, y: x, label: "<b>\"&".into(), usual: true, on_front: true };
        let svg = scatter(&[Series { name: "<i>".into(), points: vec![point(1.0), point(2.0)] }], "a<b", "c");
        let svg = svg.unwrap();
        assert!(!svg.contains("<b>") && !svg.contains("<i>") && svg.contains("&lt;b&gt;&quot;&amp;"));
        assert!(scatter(&[], "a", "b").is_none());
    }
}
