//! The models of a folder, and their contact sheet.

use std::collections::HashSet;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, Weak};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

use super::Subject;
use crate::budget::Bytes;
use crate::error::Error;
use crate::fault::usage;
use crate::jobs::batch::earlier::items;
use crate::jobs::batch::page::{SCRIPT, home_line};
use crate::load::{LoadError, LoadFault};
use crate::platform::PositionalFile;
use crate::text::{Count, data, html};

/// Most models of a contact sheet, and deepest nesting of folders.
const MAX_ENTRIES: usize = 10_000;
const MAX_DEPTH: usize = 16;
/// Most bytes of a batch's file that are served: a page with some hundred thumbnails takes some 20 MB.
const MAX_FILE: u64 = 256 << 20;

const STYLE: &str = ":root{color-scheme:light dark;--ground:#f4f5f7;--card:#fff;--ink:#1b1f24;--soft:#667080;--line:#dde1e7;--tile:#dfe4ea}\
@media(prefers-color-scheme:dark){:root{--ground:#14171b;--card:#1d2127;--ink:#e7eaee;--soft:#97a1ae;--line:#2c323a;--tile:#272d35}}\
*{box-sizing:border-box}body{margin:0;background:var(--ground);color:var(--ink);font:14px/1.45 system-ui,sans-serif}\
h1{font-size:20px;margin:0;padding:24px 28px 0;overflow-wrap:anywhere}p{margin:0;padding:2px 28px 0;color:var(--soft)}\
ul{list-style:none;margin:0;display:grid;grid-template-columns:repeat(auto-fill,minmax(min(236px,100%),1fr));gap:16px;padding:16px 28px 28px}\
a{display:block;background:var(--card);border:1px solid var(--line);border-radius:10px;overflow:hidden;color:inherit;text-decoration:none}\
a:hover,a:focus-visible{outline:2px solid #c2410c}img{display:block;width:100%;aspect-ratio:1;background:var(--tile);object-fit:contain}\
span{display:block;padding:8px 12px 0;overflow-wrap:anywhere}small{display:block;padding:0 12px 10px;color:var(--soft)}";

/// A file of the sheet, opened when it is looked at.
pub(super) struct Entry {
    /// Path within the folder.
    name: PathBuf,
    path: PathBuf,
    bytes: u64,
    opened: Mutex<Weak<Subject>>,
}

impl Entry {
    /// The entry of a single file.
    pub(super) fn of(path: &Path) -> Self {
        Self { name: PathBuf::new(), path: path.to_path_buf(), bytes: 0, opened: Mutex::default() }
    }

    /// The opened model, from before or opened now.
    ///
    /// # Errors
    /// It cannot be used.
    pub(super) fn open(&self) -> Result<Arc<Subject>, Error> {
        let mut opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(subject) = opened.upgrade() {
            return Ok(subject);
        }
        let subject = Arc::new(Subject::open(&self.path)?);
        *opened = Arc::downgrade(&subject);
        Ok(subject)
    }

    /// True once the model has been open.
    pub(super) fn was_opened(&self) -> bool {
        let opened = self.opened.lock().unwrap_or_else(PoisonError::into_inner);
        !opened.ptr_eq(&Weak::new())
    }
}

/// The models below a folder, by name. Links to folders are not followed.
///
/// # Errors
/// The folder cannot be read, or has no model.
pub(super) fn entries(folder: &Path) -> Result<Vec<Entry>, Error> {
    let mut found = Vec::new();
    walk(folder, Path::new(""), MAX_DEPTH, &mut found)
        .map_err(|cause| LoadError::from(LoadFault::Unreadable { path: folder.to_path_buf(), cause }))?;
    if found.is_empty() {
        return Err(usage!("has no models; give a folder that holds files named .oct").at(folder).into());
    }
    crate::order::by(&mut found, |a, b| a.name.cmp(&b.name));
    Ok(found)
}

fn walk(folder: &Path, within: &Path, depth: usize, found: &mut Vec<Entry>) -> io::Result<()> {
    for entry in fs::read_dir(folder.join(within))? {
        let entry = entry?;
        let (name, kind) = (within.join(entry.file_name()), entry.file_type()?);
        if kind.is_dir() && depth > 0 {
            // Unreadable folders are left out.
            let _unreadable = walk(folder, &name, depth - 1, found);
        } else if name.extension().is_some_and(|suffix| suffix.eq_ignore_ascii_case("oct")) && !kind.is_dir()
        {
            if found.len() >= MAX_ENTRIES {
                break;
            }
            let path = entry.path();
            let bytes = fs::metadata(&path).map_or(0, |metadata| metadata.len());
            found.push(Entry { name, bytes, ..Entry::of(&path) });
        }
    }
    Ok(())
}

/// The contact sheet that a batch wrote into its folder, with the folders and reasons of its report.
pub(super) struct BatchSheet {
    /// Content of `report.js`, for every item.
    pub(super) home: String,
    /// File names of thumbnails.
    thumbnails: HashSet<String>,
}

impl BatchSheet {
    /// File name of the page.
    const PAGE: &str = "index.html";

    /// The sheet of a folder; `None` unless a batch wrote it and it shows every model there.
    pub(super) fn of(folder: &Path, entries: &[Entry]) -> Option<Self> {
        let (mut models, mut thumbnails) = (HashSet::new(), HashSet::new());
        let mut home = "const report = [\n".to_owned();
        let mut left = MAX_ENTRIES;
        items(folder, &mut |_, item| {
            left = left.checked_sub(1).ok_or(io::ErrorKind::FileTooLarge)?;
            home.push_str(&home_line(&item));
            if let Some(model) = item.model {
                thumbnails.extend(model.thumbnail.filter(|name| !name.contains('/')));
                models.insert(PathBuf::from(model.file));
            }
            Ok(())
        })
        .ok()?;
        home.push_str("];\n");
        let shows_all = entries.iter().all(|entry| models.contains(&entry.name));
        (shows_all && folder.join(Self::PAGE).is_file()).then_some(Self { home, thumbnails })
    }

    /// A file that the page requests: the page itself, or a thumbnail.
    pub(super) fn file(&self, folder: &Path, name: &str) -> Option<(&'static str, Vec<u8>)> {
        let (kind, name) = match name {
            "" => ("text/html; charset=utf-8", Self::PAGE),
            _ => ("image/png", self.thumbnails.get(name)?.as_str()),
        };
        let mut bytes = Vec::new();
        PositionalFile::open(&folder.join(name))
            .ok()?
            .onwards(0)
            .take(MAX_FILE)
            .read_to_end(&mut bytes)
            .ok()?;
        Some((kind, bytes))
    }

    /// Content security policy of the page: it runs the script that batches write, shows pictures, and reaches nothing
    /// outside.
    pub(super) fn policy() -> String {
        let hash = STANDARD.encode(Sha256::digest(SCRIPT));
        format!(
            "img-src 'self' data:; script-src 'self' 'sha256-{hash}'; connect-src 'none'; font-src 'none'; frame-src 'none'; media-src 'none'; object-src 'none'; base-uri 'none'; form-action 'none'"
        )
    }
}

/// The number of the model that a contact sheet's link leads to: `NAME.oct`, or `viewer.html?model=NAME.oct`.
pub(super) fn linked(entries: &[Entry], link: &str) -> Option<usize> {
    let name = decoded(link.strip_prefix("viewer.html?model=").unwrap_or(link))?;
    entries.iter().position(|entry| entry.name == Path::new(&name))
}

/// Text of an address with its `%XX` decoded.
fn decoded(text: &str) -> Option<String> {
    let mut parts = text.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        bytes.push(u8::from_str_radix(part.get(..2)?, 16).ok()?);
        bytes.extend_from_slice(part.get(2..)?.as_bytes());
    }
    String::from_utf8(bytes).ok()
}

/// The contact sheet: pictures of all models, which link to their pages.
pub(super) fn page(folder: &Path, entries: &[Entry]) -> String {
    let title = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let title = html(&data(Path::new(title.file_name().unwrap_or(title.as_os_str()))));
    let hash = STANDARD.encode(Sha256::digest(STYLE));
    let cards: String = (0..)
        .zip(entries)
        .map(|(number, entry): (usize, &Entry)| {
            format!(
                "<li><a href=\"{number}/\"><img src=\"{number}/still\" alt=\"no picture\" loading=\"lazy\"><span>{}</span><small>{}</small></a></li>\n",
                html(&data(&entry.name)),
                Bytes(entry.bytes)
            )
        })
        .collect();
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src 'self'; style-src 'sha256-{hash}'; base-uri 'none'; form-action 'none'\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><meta name=\"referrer\" content=\"no-referrer\">\
         <title>{title}</title><style>{STYLE}</style></head>\n<body><h1>{title}</h1><p>{}</p>\n<ul>\n{cards}</ul></body></html>\n",
        Count(entries.len(), "model")
    )
}
