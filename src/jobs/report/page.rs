//! `report.html`: one file that needs nothing else, light and dark.

use std::fmt::Write;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;

use super::Report;
use super::plot::{Point, Series, scatter, standalone};
use super::rows::{Costs, Drawn, Experiment, RUNS, UNEVEN_PERCENT};
use crate::text::html as escaped;

const HEAD: &str = r#"<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<title>Which setting to choose</title><style>
:root{color-scheme:light dark;--ground:#f5f6f8;--card:#fff;--ink:#1b1f24;--soft:#5f6875;--line:#dde1e7;--best:#eef6ee;
--c0:#1f6fb2;--c1:#c2571a;--c2:#2c8a4b;--c3:#8a4bb0;--c4:#b0353f;--c5:#7a6a00;--c6:#0f8a8a}
@media(prefers-color-scheme:dark){:root{--ground:#14171b;--card:#1d2127;--ink:#e7eaee;--soft:#9aa4b1;--line:#323943;--best:#1f2c22;
--c0:#6cb2ee;--c1:#f0a06a;--c2:#78cf95;--c3:#c79be8;--c4:#ff8f95;--c5:#d9c86a;--c6:#6fd0d0}}
*{box-sizing:border-box}body{margin:0;background:var(--ground);color:var(--ink);font:15px/1.5 system-ui,sans-serif}
header,main{max-width:1240px;margin:0 auto;padding:0 24px}header{padding-top:28px}h1{font-size:22px;line-height:1.35;margin:0;max-width:48ch}
summary{font-size:16px;font-weight:600;cursor:pointer}details{padding-block:12px}details[open]>summary{margin-bottom:8px}p{margin:0 0 12px;color:var(--soft);max-width:75ch}code{font:13px/1.4 ui-monospace,monospace;background:var(--card);border:1px solid var(--line);border-radius:5px;padding:1px 5px;overflow-wrap:anywhere}
section,details{background:var(--card);border:1px solid var(--line);border-radius:12px;padding:20px 22px;margin:18px 0}
dl{display:grid;grid-template-columns:max-content 1fr;gap:2px 14px;margin:10px 0 0;font-size:14px}dt{color:var(--soft)}dd{margin:0}
svg{display:block;width:100%;max-width:820px;height:auto;margin:4px 0 8px}.grid{stroke:var(--line);stroke-width:1}.frame{fill:none;stroke:var(--soft);stroke-width:1}
.tick{font-size:12px;fill:var(--soft)}.axis{font-size:13px;fill:var(--ink)}.label{font-size:12px;fill:var(--ink)}
.dot{stroke-width:2;fill:var(--card)}.front{fill:none;stroke-width:1.5;stroke-dasharray:5 4;opacity:.75}
.c0{stroke:var(--c0)}.c1{stroke:var(--c1)}.c2{stroke:var(--c2)}.c3{stroke:var(--c3)}.c4{stroke:var(--c4)}.c5{stroke:var(--c5)}.c6{stroke:var(--c6)}
.usual.c0{fill:var(--c0)}.usual.c1{fill:var(--c1)}.usual.c2{fill:var(--c2)}.usual.c3{fill:var(--c3)}.usual.c4{fill:var(--c4)}.usual.c5{fill:var(--c5)}.usual.c6{fill:var(--c6)}
.key{display:flex;flex-wrap:wrap;gap:4px 18px;margin:0 0 10px;font-size:13px;color:var(--soft)}.key svg{display:inline-block;width:14px;height:14px;margin:0 5px 0 0;vertical-align:-2px}
.pictures{display:flex;flex-wrap:wrap;gap:12px}figure{margin:0;width:180px}figcaption{font-size:13px;color:var(--soft);text-align:center;overflow-wrap:anywhere}
.wide{overflow-x:auto}.wide>svg{min-width:540px}#overview .wide>svg{min-width:0}table{border-collapse:collapse;font-size:13.5px;font-variant-numeric:tabular-nums;width:100%}
th{text-align:right;vertical-align:bottom;font-weight:600;color:var(--soft);padding:4px 6px;border-bottom:1px solid var(--line)}
td{text-align:right;padding:3px 6px;border-bottom:1px solid var(--line);white-space:nowrap}th:nth-child(-n+2),td:nth-child(-n+2){text-align:left}
@media(max-width:600px){header,main{padding:0 10px}section,details{padding:16px 12px}}@media print,(max-width:1200px){td:first-child{white-space:normal;overflow-wrap:anywhere;min-width:110px}}
@media print{.wide{overflow:visible}table{font-size:9px}th,td{padding:2px 3px}}
tr.on td{background:var(--best)}td b{font-weight:650}footer{max-width:1240px;margin:0 auto;padding:0 24px 32px;color:var(--soft);font-size:13px}
</style></head><body>
"#;

/// The whole page.
pub(super) fn page(report: &Report) -> String {
    let m = &report.machine;
    let memory = m.memory_mib.map_or_else(|| "unknown".into(), |mib| format!("{mib} MiB"));
    let mut html = HEAD.to_owned();
    // Writing to a string cannot fail.
    let (first, rest) = match &report.experiments[..] {
        [first, rest @ ..] if first.id == "overview" => (Some(first), rest),
        all => (None, all),
    };
    let verdict = first.and_then(|first| first.advice.as_deref()).unwrap_or("Every setting, measured");
    let _ = write!(html, "<header><h1>{}</h1></header>\n<main>\n", escaped(verdict));
    if let Some(first) = first {
        let _ = writeln!(html, "<section id=\"overview\"><p>{}</p>", escaped(&first.about));
        body(first, &mut html);
        html.push_str("</section>\n");
    }
    let _ = writeln!(
        html,
        "<details id=\"how\"><summary>How it was measured</summary><p>Every choice was tried with everything else left alike. Errors are the same on every run and machine. Times are medians of {RUNS} runs on the machine below; the spread says how much longer the slowest run took than the fastest, and (!) marks a spread above {UNEVEN_PERCENT} %. k, M and G stand for thousands, millions and thousand millions. Wrong pixels are a part of those that show the body, so that more than 100 % can be wrong. Filled dots and bold names are defaults; dashed lines join what nothing else beats in both cost and error, and those rows are tinted.</p>\
         <dl><dt>command</dt><dd><code>{}</code></dd><dt>program</dt><dd>infobyte {}, traversal by {}</dd><dt>measured</dt><dd>{} UTC, in {:.1} s</dd><dt>machine</dt><dd>{}, {} cores, {memory}, {}</dd></dl></details>",
        escaped(&report.command),
        escaped(&m.version),
        escaped(m.traversal),
        escaped(&m.measured),
        report.wall_s,
        escaped(&m.processor),
        m.cores,
        escaped(&m.system)
    );
    for experiment in rest {
        let (id, title, about) = (experiment.id, escaped(experiment.title), escaped(&experiment.about));
        let _ = writeln!(html, "<details id=\"{id}\"><summary>{title}</summary><p>{about}</p>");
        pictures(experiment, &mut html);
        body(experiment, &mut html);
        html.push_str("</details>\n");
    }
    html.push_str("</main>\n<footer>The same figures are in report.csv and report.json beside this page. The page names what it was given.</footer></body></html>\n");
    html
}

/// The drawings, each as a file of its own: its name and its text.
pub(super) fn drawings(report: &Report) -> Vec<(String, String)> {
    let drawn = |experiment: &Experiment| {
        let (series, svg) = drawing(experiment)?;
        let names: Vec<&str> = series.iter().map(|s| s.name.as_str()).collect();
        Some((format!("{}.svg", experiment.id), standalone(&svg, &names)))
    };
    report.experiments.iter().filter_map(drawn).collect()
}

fn drawing(experiment: &Experiment) -> Option<(Vec<Series>, String)> {
    let (series, Drawn { cost, metric }) = (series(experiment), experiment.drawn);
    let svg = (!experiment.is_exact()).then(|| scatter(&series, Costs::TITLES[cost], metric.title()))??;
    Some((series, svg))
}

/// The drawing with its key, and the table.
fn body(experiment: &Experiment, html: &mut String) {
    if let Some((series, svg)) = drawing(experiment) {
        let _ = write!(html, "<div class=\"wide\">{svg}</div><div class=\"key\">");
        for (i, one) in series.iter().enumerate() {
            let _ = write!(
                html,
                "<span><svg viewBox=\"0 0 14 14\"><circle class=\"dot usual c{}\" cx=\"7\" cy=\"7\" r=\"4.5\"/></svg>{}</span>",
                i % 7,
                escaped(&one.name)
            );
        }
        html.push_str("</div>\n");
    }
    table(experiment, html);
}

/// Pictures of subjects, side by side.
fn pictures(experiment: &Experiment, html: &mut String) {
    if experiment.pictures.is_empty() {
        return;
    }
    html.push_str("<div class=\"pictures\">");
    for (name, png) in &experiment.pictures {
        let _ = write!(
            html,
            "<figure><svg viewBox=\"0 0 100 100\" role=\"img\"><title>{0}</title><image width=\"100\" height=\"100\" href=\"data:image/png;base64,{1}\"/></svg><figcaption>{0}</figcaption></figure>",
            escaped(name),
            BASE64_STANDARD.encode(png)
        );
    }
    html.push_str("</div>\n");
}

/// The rows that can be drawn, by subject.
fn series(experiment: &Experiment) -> Vec<Series> {
    let mut all: Vec<Series> = Vec::new();
    for row in &experiment.rows {
        let (Some(x), Some(y)) =
            (row.costs.values()[experiment.drawn.cost], row.errors.get(experiment.drawn.metric))
        else {
            continue;
        };
        let label = row.choice.clone();
        let point = Point { x, y, label, usual: row.usual, on_front: row.on_front };
        match all.iter_mut().find(|s| s.name == row.subject) {
            Some(known) => known.points.push(point),
            None => all.push(Series { name: row.subject.clone(), points: vec![point] }),
        }
    }
    // With one point each, it is the subjects that differ.
    if all.iter().all(|s| s.points.len() == 1) {
        for series in &mut all {
            for point in &mut series.points {
                point.label = series.name.clone();
            }
        }
    }
    all
}

fn table(experiment: &Experiment, html: &mut String) {
    let columns = experiment.columns();
    html.push_str("<div class=\"wide\"><table><thead><tr><th>subject</th><th>choice</th>");
    for column in &columns {
        let _ = write!(html, "<th>{}</th>", escaped(column.title()));
    }
    html.push_str("</tr></thead><tbody>\n");
    for row in &experiment.rows {
        let choice = escaped(&row.choice);
        let choice = if row.usual { format!("<b>{choice}</b>") } else { choice };
        let class = if row.on_front { " class=\"on\"" } else { "" };
        let _ = write!(html, "<tr{class}><td>{}</td><td>{choice}</td>", escaped(&row.subject));
        for column in &columns {
            let _ = write!(html, "<td>{}</td>", row.shown(*column));
        }
        html.push_str("</tr>\n");
    }
    html.push_str("</tbody></table></div>\n");
}
