//! The one way in which text from outside is printed: names of files, texts of headers, metadata of models, messages of
//! the system and of other programs.
//!
//! Such text may hold anything: an escape sequence that recolours a terminal or types for its user, a line feed that
//! forges a line of a report, an override of the direction of writing that makes `gpj.exe` of `exe.jpg`. All of these
//! are shown as U+FFFD, as bytes that are not text. Data (JSON, file names that are opened) keeps them; [`json`]
//! escapes them, which has the same meaning.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt::{self, Display, Formatter, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde::Serialize;

/// Replacement of a character that is not shown.
const REPLACEMENT: char = char::REPLACEMENT_CHARACTER;

/// True for a character with an effect besides its display: controls (C0, DEL, C1), separators of lines and paragraphs,
/// and characters that turn the direction of writing.
fn is_active(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{061c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// A file that sentences name differently.
static RENAMED: OnceLock<(PathBuf, &str)> = OnceLock::new();

/// Makes every sentence of this process name the file at `path` as `name`, for instance a file into which a stream was
/// spooled; the first call counts.
pub fn call(path: PathBuf, name: &'static str) {
    let _ = RENAMED.set((path, name));
}

/// Foreign text on one line, fit for people: see [`shown`].
pub struct Shown<'a>(&'a OsStr);

/// Foreign text for printing, such as a string or a path: nothing in it acts, and it ends no line. Bytes that are not
/// text are replaced.
pub fn shown<T: AsRef<OsStr> + ?Sized>(text: &T) -> Shown<'_> {
    Shown(text.as_ref())
}

impl Display for Shown<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let text = self.0.to_string_lossy();
        match RENAMED.get() {
            Some((path, name)) if path.as_os_str() == OsStr::new(&*text) => name.fmt(f),
            _ => plain(&text, false).fmt(f),
        }
    }
}

/// A path as data, for JSON and CSV: unchanged, except for bytes that are not text, and with `/` on Windows, too.
/// Printing requires [`shown`].
pub fn data(path: &Path) -> String {
    crate::platform::as_reported(path.as_os_str().to_string_lossy().into_owned())
}

/// A text without characters that act; line feeds are kept if `lines` is set.
///
/// All output to a terminal, to HTML or to CSV passes through here last, so that a text that was forgotten does no
/// harm.
pub fn plain(text: &str, lines: bool) -> Cow<'_, str> {
    let acts = |c: char| is_active(c) && !(lines && c == '\n');
    if text.chars().any(acts) {
        text.chars().map(|c| if acts(c) { REPLACEMENT } else { c }).collect::<String>().into()
    } else {
        text.into()
    }
}

/// A value as JSON on one line, with every active character escaped: the same value to every reader.
pub fn json<T: Serialize + ?Sized>(value: &T) -> String {
    escaped(serde_json::to_string(value).unwrap_or_default())
}

fn escaped(text: String) -> String {
    if !text.contains(is_active) {
        return text;
    }
    let mut escaped = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        // Such characters only occur in strings.
        if is_active(c) {
            for unit in c.encode_utf16(&mut [0; 2]) {
                // Writing to a string cannot fail.
                let _ = write!(escaped, "\\u{unit:04x}");
            }
        } else {
            escaped.push(c);
        }
    }
    escaped
}

/// Text from outside as text of an HTML page, or between the quotes of an attribute.
pub(crate) fn html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in plain(text, false).chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json as value};

    const ACTIVE: &str = "a\u{1b}[31m\n\r\t\u{7f}\u{9b}2J\u{202e}gpj\u{2066}\u{2069}\u{200f}\u{2028}b";

    #[test]
    fn nothing_acts_and_nothing_else_is_changed() {
        let text = shown(ACTIVE).to_string();
        assert!(!text.contains(is_active), "{text:?}");
        assert_eq!(text.chars().count(), ACTIVE.chars().count());
        assert_eq!(text.replace(REPLACEMENT, ""), "a[31m2Jgpjb");
        for sound in ["", "Gehirn-\u{e4}\u{f6}.nii", "\u{8133}/\u{1f9e0} \u{200d}", "a b"] {
            assert!(matches!(plain(sound, false), Cow::Borrowed(same) if same == sound));
            assert_eq!(shown(Path::new(sound)).to_string(), sound);
        }
        assert_eq!(plain("a\nb\r\n", true), "a\nb\u{fffd}\n");
        use crate::platform::OsStrExt;
        assert_eq!(shown(OsStr::from_bytes(b"a\xff\nb")).to_string(), "a\u{fffd}\u{fffd}b");
    }

    #[test]
    fn json_says_the_same() {
        let data = value!({ "path": ACTIVE, "plain": "\u{e4}\\\"", ACTIVE: [1.5, null] });
        let text = json(&data);
        assert!(!text.contains(is_active), "{text:?}");
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), data);
        assert_eq!(json(&value!([1, "x"])), value!([1, "x"]).to_string());
    }

    #[test]
    fn texts_cannot_break_out_of_the_page() {
        assert_eq!(html("<a b=\"c\" d='e'>&\n"), "&lt;a b=&quot;c&quot; d=&#39;e&#39;&gt;&amp;\u{fffd}");
    }
}
