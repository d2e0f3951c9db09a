//! `index.html`: a contact sheet of the thumbnails, in one file without references to others.
//!
//! The page may be passed on: it names volumes by their ids and quotes no sentence about an input, as these may name
//! files. Files and folders are named only on request, or while `report.js` lies next to the page: that file stays at
//! home, as the other reports do.

use std::io::{self, Write};
use std::path::Path;

use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;

use super::record::{Cause, Item, Journal, ModelFacts, Status};
use super::report::{BatchReport, LeftOutCount, NOTICE, status};
use crate::budget::Bytes;
use crate::format::SurfaceKind;
use crate::jobs::info::noun;
use crate::platform::PositionalFile;
use crate::source::BurnedIn;
use crate::text::{self, Count, html};

/// Most thumbnails that are embedded in the page; larger batches refer to the files beside it, or the page would be too
/// large to open.
const MAX_EMBEDDED: u64 = 400;

const HEAD: &str = r#"<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">
<link rel="icon" href="data:,"><title>Contact sheet</title><style>
:root{color-scheme:light dark;--ground:#f4f5f7;--card:#fff;--ink:#1b1f24;--soft:#667080;--line:#dde1e7;--bad:#b3261e;--note:#8a5a00;--tile:linear-gradient(#e9edf2,#cfd6df)}
@media(prefers-color-scheme:dark){:root{--ground:#14171b;--card:#1d2127;--ink:#e7eaee;--soft:#97a1ae;--line:#2c323a;--bad:#ff8a80;--note:#e0b35a;--tile:linear-gradient(#323943,#1b2027)}}
*{box-sizing:border-box}body{margin:0;background:var(--ground);color:var(--ink);font:14px/1.45 system-ui,sans-serif}
header{padding:24px 28px 12px}h1{font-size:20px;margin:0 0 4px}h2{font-size:15px;margin:20px 28px 8px}p.sum{margin:0;color:var(--soft)}body>.in{margin:10px 28px 0;color:var(--note)}a{color:inherit}
.bar{position:sticky;top:0;z-index:1;background:var(--ground);padding:8px 28px;display:flex;flex-wrap:wrap;gap:8px;border-bottom:1px solid var(--line)}
.bar input[type=search]{flex:1 1 14em;min-width:0;max-width:26em;padding:6px 10px;border:1px solid var(--line);border-radius:6px;background:var(--card);color:inherit;font:inherit}
.bar select{border:1px solid var(--line);border-radius:6px;background:var(--card);color:inherit;font:inherit}.bar label{display:flex;align-items:center;gap:5px;color:var(--soft)}
main{display:grid;grid-template-columns:repeat(auto-fill,minmax(236px,1fr));gap:16px;padding:16px 28px 28px}
article{background:var(--card);border:1px solid var(--line);border-radius:10px;overflow:hidden;display:flex;flex-direction:column;content-visibility:auto;contain-intrinsic-size:auto 480px}main.list article{contain-intrinsic-size:auto 120px}
main{align-items:start}main.list{grid-template-columns:repeat(auto-fill,minmax(min(380px,100%),1fr));padding-top:4px}article.failed{border-left:3px solid var(--bad)}.shot{background:var(--tile);aspect-ratio:1;display:flex;align-items:center;justify-content:center}
.shot a{width:100%;height:100%}.shot img{display:block;width:100%;height:100%;object-fit:contain}.shot span{font-size:13px;color:var(--soft);padding:16px;text-align:center}
.text{padding:10px 12px 12px;overflow-wrap:anywhere}.text h3{font-size:14px;margin:0 0 2px}h3 a:not(:hover){text-decoration:none}.text .in{color:var(--soft);font-size:12px;margin:0 0 6px}
dl{display:grid;grid-template-columns:auto 1fr;gap:0 10px;margin:0;font-size:12.5px;font-variant-numeric:tabular-nums}dt{color:var(--soft)}dd{margin:0;text-align:right}
.why{color:var(--bad);margin:6px 0 0;font-size:12.5px}ul{margin:8px 0 0;padding:0;list-style:none;font-size:12px;color:var(--note)}li+li{margin-top:3px}
table{margin:0 28px 28px;border-collapse:collapse;font-size:13px}td{padding:3px 14px 3px 0;border-top:1px solid var(--line);color:var(--soft)}
@page{margin:12mm}@media print{body{background:none}.bar{display:none}header,main{padding:0 0 8px}article{break-inside:avoid;content-visibility:visible}main:not(.list){grid-template-columns:repeat(5,1fr);gap:8px}.shot{print-color-adjust:exact}
.text{padding:5px 6px}.text h3{font-size:10px}.text .in,.why,dl,ul{font-size:8px}dl{gap:0 5px}}
</style></head><body>
"#;

/// Script that filters and sorts cards, links pictures to models, and shows the folders and reasons of `report.js`.
pub(in crate::jobs) const SCRIPT: &str = r#"
const q=document.getElementById("q"),f=document.getElementById("f"),none=document.getElementById("none"),all=[...document.querySelectorAll("article")];
function sift(){const w=q.value.toLowerCase();for(const a of all)a.hidden=!a.textContent.toLowerCase().includes(w)||(f.checked&&!a.classList.contains("failed"));
for(const a of all)a.style.display=a.hidden?"none":"";none.hidden=!w||all.some(a=>!a.hidden)}
const s=document.getElementById("s"),cards=document.querySelector("main"),found=[...cards.children];
const keys={name:a=>a.querySelector("h3").textContent,kind:a=>a.querySelector(".in").textContent,size:a=>-a.dataset.bytes};
s.addEventListener("change",()=>{const k=keys[s.value],n=new Intl.Collator(undefined,{numeric:true}).compare;
cards.append(...(k?found.map(a=>[k(a),a]).sort(([a],[b])=>typeof a=="number"?a-b:n(a,b)).map(r=>r[1]):found))});
q.addEventListener("input",sift);f.addEventListener("change",sift);
if(location.protocol!="file:")for(const a of cards.querySelectorAll(".shot a"))
a.href="viewer.html?model="+encodeURIComponent(a.closest("article").querySelector("h3 a").getAttribute("href"));
if(typeof report!="undefined"){const at=new Map(report.map(r=>[r[0],r]));
for(const a of all){const r=at.get(a.querySelector("h3").textContent);if(!r)continue;
a.querySelector(".file").textContent=r[1];if(r[2])a.querySelector(".why").textContent=r[2]}}
"#;

/// Page that the pictures of a contact sheet lead to on a web server: a page from a file may not read another file.
pub(super) const VIEWER: &str = "viewer.html";

/// File of the names that the page shows only at home.
pub(in crate::jobs) const HOME: &str = "report.js";

/// Writes the page; one thumbnail at a time is in memory.
pub(super) fn write(
    report: &BatchReport,
    out: &Path,
    journal: &Journal,
    w: &mut dyn Write,
) -> io::Result<()> {
    let c = report.counts;
    w.write_all(HEAD.as_bytes())?;
    write!(
        w,
        "<header><h1>Contact sheet</h1><p class=\"sum\">{}: {} converted, {} skipped, <a href=\"#failed\">{} failed</a> \
         &middot; {:.1} s with {} &middot; peak memory of the whole process {} of {} allowed</p>\n\
         <p class=\"sum\">The folder holds {}, {}, with {}. On a web server pictures lead to models that turn; \
         without one, <code>oct view</code> of this folder shows them.</p></header>\n\
         <div class=\"bar\"><input id=\"q\" type=\"search\" placeholder=\"Filter by name, kind, size …\" \
         aria-label=\"Filter\"><select id=\"s\" aria-label=\"Order\"><option value=\"\">as found\
         <option>name<option>kind<option value=\"size\">largest first</select><label><input id=\"f\" type=\"checkbox\"> failed only</label></div>\n\
         <p class=\"in\" id=\"none\" hidden>0 of {} found. Names of files and folders are left out of this page for privacy; \
         report.csv has them.</p>\n",
        Count(c.converted + c.skipped + c.failed, "volume"),
        c.converted,
        c.skipped,
        c.failed,
        report.wall_s,
        Count(report.jobs, "job"),
        Bytes(report.peak_rss_bytes),
        Bytes(report.memory_budget_bytes),
        Count(report.holds.models, "model"),
        Bytes(report.holds.bytes),
        Count(report.holds.thumbnails, "thumbnail"),
        c.converted + c.skipped + c.failed
    )?;
    for warning in &report.warnings {
        writeln!(w, "<p class=\"in\">{}</p>", html(warning))?;
    }
    w.write_all(b"<main>\n")?;
    let embed = report.holds.models <= MAX_EMBEDDED;
    journal.for_each(&mut |item| {
        item.model.as_ref().map_or(Ok(()), |model| card((&item, model), report, out, embed, w))
    })?;
    w.write_all(b"</main>\n")?;
    for (ended, head) in [
        (
            Status::Failed,
            "<h2 id=\"failed\">Not converted</h2><p class=\"sum\" style=\"margin:0 28px 8px\">Files are named in report.csv, in the line of the same name, and here while report.js lies next to this page. Both stay at home.</p>",
        ),
        (Status::Skipped, "<h2>Left alone</h2>"),
    ] {
        let mut any = false;
        journal.for_each(&mut |item| {
            if item.model.is_some() || item.status != ended {
                return Ok(());
            }
            if !std::mem::replace(&mut any, true) {
                writeln!(w, "{head}\n<main class=\"list\">")?;
            }
            without_model(&item, report, w)
        })?;
        if any {
            w.write_all(b"</main>\n")?;
        }
    }
    if !report.left_out.is_empty() {
        w.write_all(b"<h2>Files that are not volumes</h2><table>\n")?;
        for LeftOutCount { reason, count, first } in &report.left_out {
            write!(w, "<tr><td>{count}</td><td>{}</td>", html(reason))?;
            if report.keep_names {
                write!(w, "<td>first: {}</td>", html(first))?;
            }
            w.write_all(b"</tr>\n")?;
        }
        w.write_all(b"</table>\n")?;
    }
    writeln!(w, "<script src=\"{HOME}\"></script>")?;
    writeln!(w, "<script>{SCRIPT}</script>\n</body></html>")
}

/// Writes `report.js`: the name of each volume, its file or folder, and the reason why it has no model.
pub(super) fn write_home(journal: &Journal, w: &mut dyn Write) -> io::Result<()> {
    write!(w, "// This file {NOTICE}.\nconst report = [\n")?;
    journal.for_each(&mut |item| w.write_all(home_line(&item).as_bytes()))?;
    w.write_all(b"];\n")
}

/// The line of a volume in `report.js`.
pub(in crate::jobs) fn home_line(item: &Item) -> String {
    format!("{},\n", text::json(&(&item.name, &item.input, &item.reason)))
}

/// Kind of a volume, and its place if the page may name files.
fn kind(item: &Item, report: &BatchReport) -> String {
    let part = if item.part.is_empty() { String::new() } else { format!(", {}", item.part) };
    let input = if report.keep_names { format!(" · {}", item.input) } else { String::new() };
    html(&format!("{}{part}{input}", item.kind))
}

/// The reason for a missing model, without any name of a file.
fn why(cause: &Cause) -> String {
    let text = match cause {
        Cause::FewSlices => "it has fewer slices than asked for",
        Cause::NotAskedFor => "it is not of the modalities or series that were asked for",
        Cause::CopyOf(name) => return format!("it is a copy of what {name} is made of"),
        Cause::Input => "it cannot be used as a volume; the report says why",
        Cause::Empty => "no voxel is inside; the report says which values there are",
        Cause::Memory => "it takes more memory than allowed; the report says how much",
        Cause::Disk => "the disk failed or is full; the report says which",
        Cause::Options => "the options do not fit it; the report says which",
        Cause::Defect => "an internal error; the report says where",
    };
    text.into()
}

/// A volume without a model: its kind, and the reason.
fn without_model(item: &Item, report: &BatchReport, w: &mut dyn Write) -> io::Result<()> {
    write!(
        w,
        "<article class=\"{}\"><div class=\"text\"><h3>{}</h3><p class=\"in\">{}, {}, {}, {}</p>",
        status(item.status),
        html(&item.name),
        kind(item, report),
        html(&item.format),
        Count(item.files, "file"),
        Bytes(item.input_bytes)
    )?;
    let why = item.cause.as_ref().map(why).unwrap_or_default();
    write!(w, "<p class=\"in file\"></p><p class=\"why\">{}</p>", html(&why))?;
    w.write_all(b"</div></article>\n")
}

/// A volume with its model.
fn card(
    (item, m): (&Item, &ModelFacts),
    report: &BatchReport,
    out: &Path,
    embed: bool,
    w: &mut dyn Write,
) -> io::Result<()> {
    write!(w, "<article class=\"{}\" data-bytes={}><div class=\"shot\">", status(item.status), m.bytes)?;
    match &m.thumbnail {
        None => {
            let why = match item.burned_in {
                Some(BurnedIn::Stated) => ": the pixels carry text",
                Some(_) => ": the pixels may carry text",
                None => "",
            };
            write!(w, "<span>no thumbnail{why}</span>")?;
        }
        Some(file) => {
            write!(
                w,
                "<a href=\"{}\"><img alt=\"{}\" loading=\"lazy\" src=\"",
                html(file),
                html(&item.name)
            )?;
            if !embed || !embed_png(&out.join(file), w)? {
                w.write_all(html(file).as_bytes())?;
            }
            w.write_all(b"\"></a>")?;
        }
    }
    write!(
        w,
        "</div><div class=\"text\"><h3><a href=\"{}\">{}</a></h3><p class=\"in\">{}</p><p class=\"in file\"></p>",
        html(&m.file),
        html(&item.name),
        kind(item, report)
    )?;
    w.write_all(b"<dl>")?;
    let mut row = |name: &str, value: String| write!(w, "<dt>{name}</dt><dd>{}</dd>", html(&value));
    row("source", format!("{}, {}, {}", item.format, Count(item.files, "file"), Bytes(item.input_bytes)))?;
    let [x, y, z] = m.dims;
    let [a, b, c] = m.spacing_mm.map(short);
    row("voxels", format!("{x} × {y} × {z} {}", m.dtype))?;
    row("spacing", format!("{a} × {b} × {c} mm"))?;
    let surface = if m.label_count > 0 { SurfaceKind::Cells } else { report.options.surface };
    let low = short(m.range.0);
    let inside = m.range.1.map_or_else(|| format!("≥ {low}"), |hi| format!("{low} … {}", short(hi)));
    let how = match m.selection.as_str() {
        "otsu" => " (Otsu)",
        "iso" | "range" => " (as asked)",
        _ => "",
    };
    match m.label_count {
        0 => row("inside", format!("{inside}{how}"))?,
        labels => row("labels", labels.to_string())?,
    }
    row(&format!("{}s", noun(surface)), m.skin_voxels.to_string())?;
    row("model", Bytes(m.bytes).to_string())?;
    row("time", format!("{:.2} s", m.wall_s))?;
    match m.memory_plan_bytes {
        0 => row("memory", format!("{} granted", Bytes(m.memory_bytes)))?,
        used => row("memory", format!("{} of {}", Bytes(used), Bytes(m.memory_bytes)))?,
    }
    w.write_all(b"</dl>")?;
    if !item.warnings.is_empty() {
        write!(w, "<ul><li>{} in the report</li></ul>", Count(item.warnings.len(), "note"))?;
    }
    w.write_all(b"</div></article>\n")
}

/// A number for people: at most four digits after the point.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Writes a picture as a data URI; false if it cannot be read.
fn embed_png(path: &Path, w: &mut dyn Write) -> io::Result<bool> {
    let Ok(file) = PositionalFile::open(path) else { return Ok(false) };
    w.write_all(b"data:image/png;base64,")?;
    let mut encoder = EncoderWriter::new(w, &STANDARD);
    io::copy(&mut file.onwards(0), &mut encoder)?;
    encoder.finish()?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_become_base64_of_any_length() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        for (bytes, text) in
            [(&b""[..], ""), (b"f", "Zg=="), (b"fo", "Zm8="), (b"foo", "Zm9v"), (b"foobar", "Zm9vYmFy")]
        {
            std::fs::write(&path, bytes).unwrap();
            let mut out = Vec::new();
            assert!(embed_png(&path, &mut out).unwrap());
            assert_eq!(String::from_utf8(out).unwrap(), format!("data:image/png;base64,{text}"));
        }
        std::fs::write(&path, vec![255; 10_000]).unwrap();
        let mut out = Vec::new();
        embed_png(&path, &mut out).unwrap();
        assert_eq!(out.len(), 22 + 10_000_usize.div_ceil(3) * 4);
    }
}
