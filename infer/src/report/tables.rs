//! The parts of a report that are text: what was compared, the tables, and what the figures mean.

use super::escape;
use crate::bench::store::{BenchResult, Published, RowInfo};
use crate::bench::summary::{RowSummary, SetSummary, Spread};
use nbp_env::metrics::Difference;
use std::collections::BTreeSet;

/// Ways to count coverage, as classes of the style.
const COUNTS: [(bool, &str); 2] = [(false, "exact"), (true, "released")];

pub(super) fn title(result: &BenchResult) -> String {
    let names: Vec<&str> = result.sets.iter().map(|set| set.name.as_str()).collect();
    let names = if names.is_empty() { String::new() } else { format!(": {}", names.join(", ")) };
    format!("Exploration of unknown maps{names}")
}

fn plural(count: usize, one: &str) -> String {
    format!("{count} {one}{}", if count == 1 { "" } else { "s" })
}

/// A list of terms and their descriptions, which are HTML.
fn list(items: &[(String, String)]) -> String {
    let items = items.iter().map(|(term, text)| format!("<dt>{}</dt><dd>{text}</dd>\n", escape(term)));
    format!("<dl>\n{}</dl>", items.collect::<String>())
}

/// The head of the page: what was compared.
pub(super) fn facts(result: &BenchResult) -> String {
    let about = &result.about;
    let of_set = |set: &crate::bench::SetResult| {
        format!("{}: {}, {}", escape(&set.name), plural(set.scenes.len(), "scene"), plural(set.steps, "step"))
    };
    let sets: Vec<String> = result.sets.iter().map(of_set).collect();
    let counts: BTreeSet<usize> = about.rows.iter().map(|row| row.seeds).collect();
    let seeds = counts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ");
    let one = if seeds == "1" { "seed" } else { "seeds" };
    let episodes: usize = result.sets.iter().map(|set| set.episodes.len()).sum();
    let starts = plural(about.starts, "start");
    let from = about.seed;
    let items = [
        ("Data", sets.join("<br>")),
        ("Episodes", format!("{episodes}: {starts} in each scene, the same for all; {seeds} {one} each, from {from}")),
        ("Reference", escape(&about.reference)),
        ("Version", escape(&about.version)),
    ];
    let describe = |row: &RowInfo| {
        let network = row.checkpoint.as_ref().map_or(String::new(), |from| format!(", network {}", escape(from)));
        (row.name.clone(), format!("{}{network}", row.policy))
    };
    let rows: Vec<(String, String)> = about.rows.iter().map(describe).collect();
    // Settings once for all rows that have the same.
    let mut settings: Vec<(&serde_json::Value, Vec<&str>)> = Vec::new();
    for row in &about.rows {
        match settings.iter_mut().find(|(known, _)| *known == &row.settings) {
            Some((_, names)) => names.push(&row.name),
            None => settings.push((&row.settings, vec![&row.name])),
        }
    }
    let settings = settings.into_iter().map(|(settings, names)| {
        let text = serde_json::to_string_pretty(settings).unwrap_or_default();
        format!("<p class=\"note\">{}</p>\n<pre>{}</pre>\n", escape(&names.join(", ")), escape(&text))
    });
    format!(
        "{}\n<details><summary>Policies and settings</summary>\n{}\n{}</details>",
        list(&items.map(|(term, text)| (term.to_owned(), text))),
        list(&rows),
        settings.collect::<String>()
    )
}

/// Final Cov. and AUC by the given way to count.
fn scores(row: &RowSummary, released: bool) -> [Option<Spread>; 2] {
    match released {
        false => [Some(row.coverage), Some(row.auc)],
        true => [row.released_coverage, row.released_auc],
    }
}

/// For each measure, the best mean of the rows that compete.
fn best(summary: &SetSummary, released: bool) -> [f64; 2] {
    let rows = || summary.rows.iter().filter(|row| !row.knows_map).map(|row| scores(row, released));
    [0, 1].map(|n| rows().filter_map(|row| row[n]).fold(f64::NEG_INFINITY, |best, spread| best.max(spread.mean)))
}

fn counts(summaries: &[SetSummary]) -> &'static [(bool, &'static str)] {
    let has_released = |row: &RowSummary| row.released_coverage.is_some();
    let all = summaries.iter().flat_map(|summary| &summary.rows).all(has_released);
    if all && !summaries.is_empty() { &COUNTS } else { &COUNTS[..1] }
}

/// A mean with its spread in small print or without, bold where no mean is better.
fn score(found: Option<Spread>, best: f64, spread: bool) -> String {
    let Some(Spread { mean, std }) = found else { return "<td>–</td>".into() };
    let class = if (mean - best).abs() < 5e-4 { " class=\"best\"" } else { "" };
    let std = if spread { format!(" <small>± {std:.3}</small>") } else { String::new() };
    format!("<td{class}>{mean:.3}{std}</td>")
}

/// A table of rows, given its head and the cells of each row.
fn table(class: &str, caption: &str, head: &str, rows: &[RowSummary], cells: impl Fn(&RowSummary) -> String) -> String {
    let line = |row: &RowSummary| {
        let bound = if row.knows_map { " class=\"bound\"" } else { "" };
        format!("<tr{bound}><th scope=\"row\">{}</th>{}</tr>\n", escape(&row.row), cells(row))
    };
    let lines: String = rows.iter().map(line).collect();
    let caption = if caption.is_empty() { String::new() } else { format!("<caption>{caption}</caption>\n") };
    format!(
        "<div class=\"table {class}\"><table>\n{caption}<thead>{head}</thead>\n<tbody>\n{lines}</tbody></table></div>\n"
    )
}

fn names<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().map(|name| format!("<th scope=\"col\">{name}</th>")).collect()
}

/// Groups of columns: a name and how many.
fn grouped<'a>(groups: impl IntoIterator<Item = (&'a str, usize)>) -> String {
    let group = |(name, span): (&str, usize)| match name {
        "" => format!("<th colspan=\"{span}\"></th>"),
        name => format!("<th colspan=\"{span}\" class=\"group\"><span>{}</span></th>", escape(name)),
    };
    groups.into_iter().map(group).collect()
}

/// Means of every row on every data set, as the paper's main table has them; nothing for a single set.
pub(super) fn overview(summaries: &[SetSummary]) -> String {
    let [first, _, ..] = summaries else { return String::new() };
    let sets = grouped(std::iter::once(("", 1)).chain(summaries.iter().map(|summary| (summary.set.as_str(), 2))));
    let columns = names(std::iter::once("Policy").chain(summaries.iter().flat_map(|_| ["Final Cov.", "AUC"])));
    let head = format!("<tr>{sets}</tr>\n<tr>{columns}</tr>");
    let of_count = |&(released, class): &(bool, &str)| {
        let cells = |row: &RowSummary| {
            let of_set = |summary: &SetSummary| {
                let found = summary.rows.iter().find(|other| other.row == row.row);
                let found = found.map_or([None; 2], |row| scores(row, released));
                let best = best(summary, released);
                [0, 1].map(|n| score(found[n], best[n], false)).concat()
            };
            summaries.iter().map(of_set).collect()
        };
        table(class, "", &head, &first.rows, cells)
    };
    let tables: String = counts(summaries).iter().map(of_count).collect();
    format!("<section id=\"overview\">\n<h2>Overview</h2>\n{tables}</section>")
}

/// Two tables for each data set: the figures, for each way to count coverage, and differences to the reference.
pub(super) fn tables(summaries: &[SetSummary]) -> String {
    let of_set = |summary: &SetSummary| {
        let tables = counts(summaries).iter().map(|&(released, class)| figures(summary, released, class));
        let tables: String = tables.chain(std::iter::once(differences(summary))).collect();
        format!("<div class=\"set\" data-set=\"{}\">\n{tables}</div>\n", escape(&summary.set))
    };
    summaries.iter().map(of_set).collect()
}

/// A column: its name, and the cell of a row.
type Column<'a> = (&'a str, Box<dyn Fn(&RowSummary) -> String>);

fn figures(summary: &SetSummary, released: bool, class: &str) -> String {
    let rows = &summary.rows;
    let best = best(summary, released);
    let of_score = |n: usize| Box::new(move |row: &RowSummary| score(scores(row, released)[n], best[n], true));
    let published = |mean: f64, std: Option<f64>| {
        let std = std.map_or(String::new(), |std| format!(" <small>± {std:.3}</small>"));
        format!("<td>{mean:.3}{std}</td>")
    };
    let nothing = || "<td></td>".to_owned();
    let mean = |places: usize, of: fn(&RowSummary) -> Option<Spread>| {
        Box::new(move |row: &RowSummary| {
            of(row).map_or_else(nothing, |found| format!("<td>{:.places$}</td>", found.mean))
        })
    };
    let paper = |of: fn(Published) -> (f64, Option<f64>)| {
        Box::new(move |row: &RowSummary| {
            let found = row.paper.map(of);
            found.map_or_else(nothing, |(mean, std)| published(mean, std))
        })
    };
    let groups: [(&str, Vec<Column<'_>>); 3] = [
        ("", vec![("Final Cov.", of_score(0)), ("AUC", of_score(1))]),
        (
            "Paper",
            vec![
                ("Final Cov.", paper(|paper| (paper.coverage, paper.coverage_std))),
                ("AUC", paper(|paper| (paper.auc, paper.auc_std))),
            ],
        ),
        (
            "",
            vec![
                ("of visible", mean(3, |row| row.of_visible)),
                ("Comp. %", mean(2, |row| row.completion_percent)),
                ("Comp. cm", mean(2, |row| row.completion_cm)),
                ("m walked", mean(0, |row| Some(row.path_length))),
                ("bumps", mean(1, |row| Some(row.bumps))),
            ],
        ),
    ];
    // A column only where something stands in it.
    let is_shown = |(_, cell): &Column<'_>| rows.iter().any(|row| cell(row) != nothing());
    let groups: Vec<(&str, Vec<Column<'_>>)> =
        groups.into_iter().map(|(name, columns)| (name, columns.into_iter().filter(is_shown).collect())).collect();
    let columns = || groups.iter().flat_map(|(_, columns)| columns);
    let tops = groups.iter().filter(|(_, columns)| !columns.is_empty()).map(|(name, columns)| (*name, columns.len()));
    let tops = grouped(std::iter::once(("", 1)).chain(tops));
    let head = names(std::iter::once("Policy").chain(columns().map(|(name, _)| *name)));
    let cells = |row: &RowSummary| columns().map(|(_, cell)| cell(row)).collect();
    let (scenes, steps) = (plural(summary.scenes, "scene"), plural(summary.steps, "step"));
    let caption = format!("{}: {scenes}, {steps}.", escape(&summary.set));
    table(class, &caption, &format!("<tr>{tops}</tr>\n<tr>{head}</tr>"), rows, cells)
}

/// Nothing where the reference has nobody to be compared with.
fn differences(summary: &SetSummary) -> String {
    if summary.rows.iter().all(|row| row.coverage_difference.is_none()) {
        return String::new();
    }
    let tops = grouped([("", 1), ("Final Cov.", 3), ("AUC", 3)]);
    let head = names(std::iter::once("Policy").chain(["difference", "95 %", "p"].repeat(2)));
    let cells = |row: &RowSummary| versus(row.coverage_difference) + &versus(row.auc_difference);
    let caption = format!("{}: differences to {}.", escape(&summary.set), escape(&summary.reference));
    table("exact", &caption, &format!("<tr>{tops}</tr>\n<tr>{head}</tr>"), &summary.rows, cells)
}

/// A difference, its interval, and how likely chance makes one as large.
fn versus(difference: Option<Difference>) -> String {
    let Some(Difference { mean, interval: [low, high], p }) = difference else { return "<td>–</td>".repeat(3) };
    // A minus as wide as the plus.
    let signed = |value: f64| format!("{value:+.3}").replace('-', "−");
    let p = if p < 0.001 { "&lt; 0.001".to_owned() } else { format!("{p:.3}") };
    format!("<td>{}</td><td><small>{} to {}</small></td><td>{p}</td>", signed(mean), signed(low), signed(high))
}

/// What each figure is, in a line.
pub(super) fn meaning(summaries: &[SetSummary]) -> String {
    let released = counts(summaries).len() > 1;
    let rows = || summaries.iter().flat_map(|summary| &summary.rows);
    let items = [
        (
            true,
            "Final Cov.",
            "Share of the points on a scene’s surface that lie within ε of a reconstructed point once the steps are spent.",
        ),
        (
            true,
            "AUC",
            "Area under the curve of that share over the steps, divided by their number: what is seen early counts more.",
        ),
        (
            released,
            "exact",
            "Coverage counted with every point that was kept. The default, and what differences are of.",
        ),
        (
            released,
            "as released",
            "Coverage as the released code counts it, of a random sample of the cloud, so a curve may fall: in every fifth step, on \
             a straight line between, and of 20,000 surface points (the published test: 50,000).",
        ),
        (
            true,
            "±",
            "Sample standard deviation over episodes, as the paper prints it: how much maps differ, not how sure a mean is.",
        ),
        (
            rows().any(|row| row.coverage_difference.is_some()),
            "difference, p",
            "Mean over scenes of the difference to the reference, with 95 % of a paired bootstrap over scenes (too narrow where scenes are \
             few); p is that of Fisher’s randomisation test over scenes, two-sided, not corrected for the number of comparisons.",
        ),
        (
            rows().any(|row| row.paper.is_some()),
            "Paper",
            "Published figures. They are of other maps: the order of policies can be compared, the numbers cannot.",
        ),
        (
            rows().any(|row| row.of_visible.is_some()),
            "of visible",
            "Final Cov. as a share of what can be seen from the poses of the lattice. Frames between poses see a little more.",
        ),
        (true, "bumps", "Moves that hit an obstacle; each of them spent a step."),
        (
            rows().any(|row| row.knows_map),
            "italics, bold",
            "Policies in italics look at the true map, or at its mesh before a move: they do not compete. Bold is the best of the others.",
        ),
    ];
    let shown = items.into_iter().filter(|(is_shown, ..)| *is_shown);
    list(&shown.map(|(_, term, text)| (term.to_owned(), text.to_owned())).collect::<Vec<_>>())
}
