//! Figures as SVG: coverage over time, one line for each policy and its spread as a band; and scenes under two policies.

use crate::rollout::EpisodeRecord;
use nbp_env::metrics::{auc, mean_std};
use std::fmt::Write as _;

/// One line of a plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// Covered share, 0 to 1, at the start and after each step.
    pub mean: Vec<f32>,
    /// Half the height of the band around it; empty for none.
    pub spread: Vec<f32>,
}

/// One line for each policy, in the order in which they first appear: the mean over its episodes, and their standard
/// deviation where there are several.
pub fn series(episodes: &[EpisodeRecord]) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for record in episodes {
        if all.iter().any(|series| series.name == record.policy) {
            continue;
        }
        let curves: Vec<&[f32]> =
            episodes.iter().filter(|r| r.policy == record.policy).map(|r| r.curve.as_slice()).collect();
        let steps = curves.iter().map(|curve| curve.len()).min().unwrap_or(0);
        let at = |step: usize| mean_std(&curves.iter().map(|curve| f64::from(curve[step])).collect::<Vec<_>>());
        let (mean, spread): (Vec<f32>, Vec<f32>) = (0..steps).map(at).map(|(m, s)| (m as f32, s as f32)).unzip();
        let spread = if curves.len() > 1 { spread } else { Vec::new() };
        all.push(Series { name: record.policy.clone(), mean, spread });
    }
    all
}

/// Told apart by people who do not see all colours (Okabe and Ito), darkest first.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#444444"];
/// With these, 28 lines can be told apart.
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];

/// Attributes of the line of a number.
fn ink(index: usize) -> String {
    let dashes = DASHES[index / COLOURS.len() % DASHES.len()];
    let dashes = if dashes.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dashes}\"") };
    format!("stroke=\"{}\"{dashes}", COLOURS[index % COLOURS.len()])
}

const SIZE: [f64; 2] = [760.0, 440.0];
/// More lines than this have their legend beside the axes rather than in them, and bands too faint to hide each other.
const FEW: usize = 5;
/// Left, top, right, bottom of the axes.
const AXES: [f64; 4] = [70.0, 52.0, 736.0, 382.0];

/// A plot of covered share over steps with axes, grid and legend.
pub fn coverage(title: &str, series: &[Series]) -> String {
    let steps = series.iter().map(|s| s.mean.len()).max().unwrap_or(0).saturating_sub(1).max(1);
    let x = |step: usize| AXES[0] + (AXES[2] - AXES[0]) * step as f64 / steps as f64;
    let y = |share: f32| AXES[3] - (AXES[3] - AXES[1]) * f64::from(share.clamp(0.0, 1.0));
    let is_few = series.len() <= FEW;
    let beside = if is_few { 0.0 } else { legend_width(series) + 8.0 };
    let height = SIZE[1].max(if is_few { 0.0 } else { AXES[1] + 20.0 * series.len() as f64 + 24.0 });
    let mut svg = open([SIZE[0] + beside, height]);
    let left = AXES[0];
    let _ = writeln!(svg, "<text x=\"{left}\" y=\"32\" font-size=\"16\" font-weight=\"600\">{}</text>", escape(title));
    draw_axes(&mut svg, ["step", "covered, %"], steps, x, y);
    for (index, one) in series.iter().enumerate() {
        draw_band(&mut svg, one, COLOURS[index % COLOURS.len()], if is_few { 0.13 } else { 0.05 }, x, y);
    }
    for (index, one) in series.iter().enumerate() {
        draw_line(&mut svg, one, &ink(index), x, y);
    }
    // Coverage only grows, so the upper left corner is free for a few names.
    draw_legend(&mut svg, series, if is_few { AXES[0] + 12.0 } else { AXES[2] + 12.0 });
    svg + "</svg>\n"
}

/// What walks were worth at some minutes of a training: a line with points for each measure, as a share from 0 to 1.
pub fn learning_curve(title: &str, minutes: &[f64], measures: &[(&str, Vec<f64>)]) -> String {
    let last = minutes.iter().fold(1.0, |a: f64, &b| a.max(b));
    let across = |minute: f64| AXES[0] + (AXES[2] - AXES[0]) * minute / last;
    let up = |share: f32| AXES[3] - (AXES[3] - AXES[1]) * f64::from(share.clamp(0.0, 1.0));
    let mut svg = open(SIZE);
    let left = AXES[0];
    let _ = writeln!(svg, "<text x=\"{left}\" y=\"32\" font-size=\"16\" font-weight=\"600\">{}</text>", escape(title));
    draw_axes(&mut svg, ["minutes of training", "share, %"], last as usize, |minute| across(minute as f64), up);
    for (index, (name, values)) in measures.iter().enumerate() {
        let ink = ink(index);
        let line: Vec<[f64; 2]> =
            minutes.iter().zip(values).map(|(&minute, &value)| [across(minute), up(value as f32)]).collect();
        let points: Vec<String> = line.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(svg, "<polyline points=\"{}\" fill=\"none\" {ink} stroke-width=\"2.4\"/>", points.join(" "));
        for [x, y] in &line {
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{}\"/>",
                COLOURS[index % COLOURS.len()]
            );
        }
        if let (Some([x, y]), Some(value)) = (line.last(), values.last()) {
            let label = format!("{} {value:.3}", escape(name));
            let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>", y - 12.0);
        }
    }
    svg + "</svg>\n"
}

/// The beginning of a figure of a size in pixels, with its ground.
pub(crate) fn open([width, height]: [f64; 2]) -> String {
    let [w, h] = [width.ceil(), height.ceil()];
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" \
         font-family=\"system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif\" font-size=\"13\" fill=\"#333\">\n\
         <rect width=\"{w}\" height=\"{h}\" rx=\"8\" fill=\"#fff\"/>\n"
    )
}

/// 1, 2 or 5 times a power of ten, the largest that is not above `length`.
pub(crate) fn round_below(length: f64) -> f64 {
    let power = 10_f64.powf(length.max(1e-6).log10().floor());
    [5.0, 2.0, 1.0].map(|n| n * power).into_iter().find(|round| *round <= length).unwrap_or(power)
}

/// Side of the axes of a scatter, pixels.
const SQUARE: f64 = 360.0;

/// Two policies against each other: a point for each scene, the diagonal where they are equal. `points` has the name of each
/// scene, shown where a pointer rests, and its figures from 0 to 1.
pub fn scatter(title: &str, names: [&str; 2], points: &[(String, [f64; 2])]) -> String {
    let all = || points.iter().flat_map(|(_, values)| *values);
    // Whole tenths around all of them.
    let low = (10.0 * all().fold(1.0, f64::min) - 0.2).floor().max(0.0) / 10.0;
    let high = (10.0 * all().fold(0.0, f64::max) + 0.2).ceil().min(10.0) / 10.0;
    let [low, high] = if high > low { [low, high] } else { [0.0, 1.0] };
    let (left, top) = (AXES[0], AXES[1]);
    let (right, bottom) = (left + SQUARE, top + SQUARE);
    let x = |v: f64| left + SQUARE * (v - low) / (high - low);
    let y = |v: f64| bottom - SQUARE * (v - low) / (high - low);
    let mut svg = open([right + 24.0, bottom + 58.0]);
    let _ = writeln!(svg, "<text x=\"{left}\" y=\"32\" font-size=\"16\" font-weight=\"600\">{}</text>", escape(title));
    let ticks = ((high - low) * 10.0).round() as usize;
    for tick in 0..=ticks {
        let value = low + tick as f64 / 10.0;
        let (across, up) = (x(value), y(value));
        let colour = if tick == 0 { "#555" } else { "#e3e6ea" };
        let _ = writeln!(svg, "<path d=\"M{left} {up:.1}H{right}M{across:.1} {bottom}V{top}\" stroke=\"{colour}\"/>");
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value:.1}</text>", left - 9.0, up + 4.5);
        let _ =
            writeln!(svg, "<text x=\"{across:.1}\" y=\"{}\" text-anchor=\"middle\">{value:.1}</text>", bottom + 19.0);
    }
    let _ = writeln!(svg, "<path d=\"M{left} {bottom}L{right} {top}\" stroke=\"#777\" stroke-dasharray=\"3 4\"/>");
    let [middle, side] = [(left + right) / 2.0, (top + bottom) / 2.0];
    let [across, up] = names.map(|name| format!("{}, Final Cov.", escape(name)));
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{across}</text>", bottom + 44.0);
    let _ = writeln!(svg, "<text transform=\"translate(22 {side}) rotate(-90)\" text-anchor=\"middle\">{up}</text>");
    for (name, [a, b]) in points {
        let _ = writeln!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"5\" fill=\"{}\" fill-opacity=\"0.75\"><title>{}: {a:.3}, {b:.3}</title></circle>",
            x(*a),
            y(*b),
            COLOURS[0],
            escape(name)
        );
    }
    svg + "</svg>\n"
}

/// Axes with their names, from 0 to `last` and from 0 to 100 %.
fn draw_axes(svg: &mut String, [across, up]: [&str; 2], last: usize, x: impl Fn(usize) -> f64, y: impl Fn(f32) -> f64) {
    for percent in (0..=100_u8).step_by(20) {
        let at = y(f32::from(percent) / 100.0);
        let colour = if percent == 0 { "#555" } else { "#e3e6ea" };
        let [left, right] = [AXES[0], AXES[2]];
        let _ = writeln!(svg, "<path d=\"M{left} {at:.1}H{right}\" stroke=\"{colour}\"/>");
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{percent}</text>", left - 9.0, at + 4.5);
    }
    for round in (0..=last).step_by(tick(last)) {
        let (at, bottom) = (x(round), AXES[3]);
        let _ = writeln!(svg, "<path d=\"M{at:.1} {bottom}v5\" stroke=\"#555\"/>");
        let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{round}</text>", bottom + 21.0);
    }
    let (middle, bottom) = ((AXES[0] + AXES[2]) / 2.0, AXES[3] + 44.0);
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{bottom}\" text-anchor=\"middle\">{across}</text>");
    let side = (AXES[1] + AXES[3]) / 2.0;
    let _ = writeln!(svg, "<text transform=\"translate(22 {side}) rotate(-90)\" text-anchor=\"middle\">{up}</text>");
}

/// 1, 2 or 5 times a power of ten, so that an axis has at most ten ticks.
fn tick(steps: usize) -> usize {
    let mut power = 1;
    loop {
        if let Some(stride) = [1, 2, 5].map(|n| n * power).into_iter().find(|stride| steps / stride <= 10) {
            return stride;
        }
        power *= 10;
    }
}

/// Pairs of pixels of an SVG.
fn points(values: impl Iterator<Item = (usize, f32)>, x: impl Fn(usize) -> f64, y: impl Fn(f32) -> f64) -> String {
    values.map(|(step, value)| format!("{:.1},{:.1}", x(step), y(value))).collect::<Vec<_>>().join(" ")
}

fn draw_band(
    svg: &mut String,
    series: &Series,
    colour: &str,
    opacity: f64,
    x: impl Fn(usize) -> f64,
    y: impl Fn(f32) -> f64,
) {
    if series.spread.len() == series.mean.len() && !series.mean.is_empty() {
        let edge = |sign: f32| series.mean.iter().zip(&series.spread).map(move |(m, s)| m + sign * s).enumerate();
        let back: Vec<_> = edge(-1.0).collect();
        let outline = points(edge(1.0).chain(back.into_iter().rev()), x, y);
        let _ = writeln!(svg, "<polygon points=\"{outline}\" fill=\"{colour}\" fill-opacity=\"{opacity}\"/>");
    }
}

fn draw_line(svg: &mut String, series: &Series, ink: &str, x: impl Fn(usize) -> f64, y: impl Fn(f32) -> f64) {
    let line = points(series.mean.iter().copied().enumerate(), x, y);
    let _ = writeln!(
        svg,
        "<polyline points=\"{line}\" fill=\"none\" {ink} stroke-width=\"2.4\" stroke-linejoin=\"round\"/>"
    );
}

fn legend_width(series: &[Series]) -> f64 {
    8.0 * series.iter().map(|s| s.name.chars().count()).max().unwrap_or(0) as f64 + 196.0
}

fn draw_legend(svg: &mut String, series: &[Series], left: f64) {
    let mut order: Vec<usize> = (0..series.len()).collect();
    let last = |index: &usize| series[*index].mean.last().copied().unwrap_or(0.0);
    // As the lines end, from top to bottom.
    order.sort_by(|a, b| last(b).total_cmp(&last(a)));
    let (width, top) = (legend_width(series), AXES[1] + 6.0);
    let height = 20.0 * series.len() as f64 + 6.0;
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{height}\" rx=\"5\" fill=\"#fff\" fill-opacity=\"0.85\" \
         stroke=\"#d5d9de\"/>",
        top - 2.0
    );
    for (line, &index) in order.iter().enumerate() {
        let at = top + 15.0 + 20.0 * line as f64;
        let (from, middle, ink) = (left + 8.0, at - 4.5, ink(index));
        let _ = writeln!(svg, "<path d=\"M{from:.1} {middle:.1}h26\" {ink} stroke-width=\"3\"/>");
        let name = escape(&series[index].name);
        let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{at:.1}\">{name}</text>", left + 40.0);
        let figures = format!("{:.1} %  ·  AUC {:.3}", 100.0 * last(&index), auc(&series[index].mean));
        let _ = writeln!(
            svg,
            "<text x=\"{:.1}\" y=\"{at:.1}\" text-anchor=\"end\" fill=\"#777\">{figures}</text>",
            left + width - 10.0
        );
    }
}

/// A text as part of an SVG or HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::tests::record;

    #[test]
    fn policies_become_lines_with_bands() {
        let episodes = [
            record(),
            EpisodeRecord { curve: vec![0.1, 0.4, 0.45], ..record() },
            EpisodeRecord { policy: "a<b".into(), ..record() },
        ];
        let lines = series(&episodes);
        assert_eq!(lines.len(), 2);
        assert!((lines[0].mean[1] - 0.3).abs() < 1e-6 && lines[0].spread[0] == 0.0);
        assert!(lines[1].spread.is_empty());
        let svg = coverage("Rooms & halls", &lines);
        assert_eq!((svg.matches("<polyline").count(), svg.matches("<polygon").count()), (2, 1));
        assert!(svg.contains("Rooms &amp; halls") && svg.contains("a&lt;b"));
        assert!(coverage("empty", &[]).ends_with("</svg>\n"));
    }

    #[test]
    fn learning_curves_end_in_their_last_figures() {
        let svg = learning_curve(
            "nbp",
            &[5.0, 11.0, 42.4],
            &[("Final Cov.", vec![0.6, 0.7, 0.711]), ("AUC", vec![0.5, 0.52, 0.55])],
        );
        assert_eq!((svg.matches("<polyline").count(), svg.matches("<circle").count()), (2, 6));
        assert!(svg.contains("Final Cov. 0.711") && svg.contains("minutes of training") && svg.contains(">35</text>"));
        assert!(learning_curve("empty", &[], &[]).ends_with("</svg>\n"));
    }

    #[test]
    fn axes_have_a_handful_of_round_ticks() {
        assert_eq!([1, 10, 11, 100, 101, 500, 1000].map(tick), [1, 1, 2, 10, 10, 50, 100]);
    }
}
