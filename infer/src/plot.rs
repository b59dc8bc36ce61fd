//! Coverage over time as an SVG: one line for each policy, its spread as a band.

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

const SIZE: [f64; 2] = [760.0, 440.0];
/// Left, top, right, bottom of the axes.
const AXES: [f64; 4] = [70.0, 52.0, 736.0, 382.0];

/// A plot of covered share over steps with axes, grid and legend.
pub fn coverage(title: &str, series: &[Series]) -> String {
    let steps = series.iter().map(|s| s.mean.len()).max().unwrap_or(0).saturating_sub(1).max(1);
    let x = |step: usize| AXES[0] + (AXES[2] - AXES[0]) * step as f64 / steps as f64;
    let y = |share: f32| AXES[3] - (AXES[3] - AXES[1]) * f64::from(share.clamp(0.0, 1.0));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" \
         font-family=\"system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif\" font-size=\"13\" fill=\"#333\">\n\
         <rect width=\"{w}\" height=\"{h}\" rx=\"8\" fill=\"#fff\"/>\n\
         <text x=\"{left}\" y=\"32\" font-size=\"16\" font-weight=\"600\">{title}</text>\n",
        w = SIZE[0],
        h = SIZE[1],
        left = AXES[0],
        title = escape(title),
    );
    draw_axes(&mut svg, steps, x, y);
    for (index, one) in series.iter().enumerate() {
        draw_series(&mut svg, one, COLOURS[index % COLOURS.len()], x, y);
    }
    draw_legend(&mut svg, series);
    svg + "</svg>\n"
}

fn draw_axes(svg: &mut String, steps: usize, x: impl Fn(usize) -> f64, y: impl Fn(f32) -> f64) {
    for percent in (0..=100_u8).step_by(20) {
        let at = y(f32::from(percent) / 100.0);
        let colour = if percent == 0 { "#555" } else { "#e3e6ea" };
        let [left, right] = [AXES[0], AXES[2]];
        let _ = writeln!(svg, "<path d=\"M{left} {at:.1}H{right}\" stroke=\"{colour}\"/>");
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{percent}</text>", left - 9.0, at + 4.5);
    }
    let stride = tick(steps);
    for step in (0..=steps).step_by(stride) {
        let (at, bottom) = (x(step), AXES[3]);
        let _ = writeln!(svg, "<path d=\"M{at:.1} {bottom}v5\" stroke=\"#555\"/>");
        let _ = writeln!(svg, "<text x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{step}</text>", bottom + 21.0);
    }
    let (middle, bottom) = ((AXES[0] + AXES[2]) / 2.0, AXES[3] + 44.0);
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{bottom}\" text-anchor=\"middle\">step</text>");
    let side = (AXES[1] + AXES[3]) / 2.0;
    let _ =
        writeln!(svg, "<text transform=\"translate(22 {side}) rotate(-90)\" text-anchor=\"middle\">covered, %</text>");
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

fn draw_series(svg: &mut String, series: &Series, colour: &str, x: impl Fn(usize) -> f64, y: impl Fn(f32) -> f64) {
    let points = |values: &mut dyn Iterator<Item = (usize, f32)>| {
        let pairs: Vec<String> = values.map(|(step, value)| format!("{:.1},{:.1}", x(step), y(value))).collect();
        pairs.join(" ")
    };
    if series.spread.len() == series.mean.len() && !series.mean.is_empty() {
        let edge = |sign: f32| series.mean.iter().zip(&series.spread).map(move |(m, s)| m + sign * s).enumerate();
        let back: Vec<_> = edge(-1.0).collect();
        let outline = points(&mut edge(1.0).chain(back.into_iter().rev()));
        let _ = writeln!(svg, "<polygon points=\"{outline}\" fill=\"{colour}\" fill-opacity=\"0.13\"/>");
    }
    let line = points(&mut series.mean.iter().copied().enumerate());
    let _ = writeln!(
        svg,
        "<polyline points=\"{line}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2.4\" stroke-linejoin=\"round\"/>"
    );
}

fn draw_legend(svg: &mut String, series: &[Series]) {
    let mut order: Vec<usize> = (0..series.len()).collect();
    let last = |index: &usize| series[*index].mean.last().copied().unwrap_or(0.0);
    // As the lines end, from top to bottom.
    order.sort_by(|a, b| last(b).total_cmp(&last(a)));
    let longest = series.iter().map(|s| s.name.chars().count()).max().unwrap_or(0);
    let width = 8.0 * longest as f64 + 196.0;
    // Coverage only grows, so the upper left corner is free.
    let (left, top) = (AXES[0] + 12.0, AXES[1] + 6.0);
    let height = 20.0 * series.len() as f64 + 6.0;
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{width:.1}\" height=\"{height}\" rx=\"5\" fill=\"#fff\" fill-opacity=\"0.85\" \
         stroke=\"#d5d9de\"/>",
        top - 2.0
    );
    for (line, &index) in order.iter().enumerate() {
        let (at, colour) = (top + 15.0 + 20.0 * line as f64, COLOURS[index % COLOURS.len()]);
        let _ = writeln!(
            svg,
            "<path d=\"M{:.1} {:.1}h22\" stroke=\"{colour}\" stroke-width=\"3\"/>",
            left + 10.0,
            at - 4.5
        );
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

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
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
    fn axes_have_a_handful_of_round_ticks() {
        assert_eq!([1, 10, 11, 100, 101, 500, 1000].map(tick), [1, 1, 2, 10, 10, 50, 100]);
    }
}
