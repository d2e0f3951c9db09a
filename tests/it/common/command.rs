//! Runs the `oct` command as a user would, and reads what it says.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// The binary under test: `OCT_BINARY` if set (a release build, say), else that of this test run.
pub(crate) fn binary() -> PathBuf {
    std::env::var_os("OCT_BINARY").map_or_else(|| env!("CARGO_BIN_EXE_oct").into(), PathBuf::from)
}

/// What a run left behind.
#[derive(Debug)]
pub(crate) struct Run {
    /// Exit code; -1 when a signal ended it.
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Run {
    pub(crate) fn of(output: &Output) -> Self {
        let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
        Self {
            code: output.status.code().unwrap_or(-1),
            stdout: text(&output.stdout),
            stderr: text(&output.stderr),
        }
    }

    /// The one JSON object on stdout.
    pub(crate) fn json(&self) -> Value {
        assert_eq!(self.code, 0, "{self:?}");
        let value: Value = serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {self:?}"));
        assert!(value.is_object(), "{value}");
        value
    }

    /// Checks a refusal: the exit code, and one sentence on one line that holds `words`; on stdout nothing, or one
    /// JSON object that says the same.
    pub(crate) fn refused(&self, code: i32, words: &[&str]) {
        assert_eq!(self.code, code, "{self:?}");
        assert!(!self.stderr.contains("panicked"), "{self:?}");
        let sentence = self.stderr.strip_suffix('\n').unwrap_or_else(|| panic!("no full line: {self:?}"));
        assert!(sentence.starts_with("oct: ") && !sentence.contains('\n'), "not one line: {self:?}");
        if !self.stdout.is_empty() {
            let told: Value = serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {self:?}"));
            assert_eq!(told["error"].as_str(), sentence.strip_prefix("oct: "), "{self:?}");
            assert_eq!(told["exit_code"], code, "{self:?}");
        }
        for word in words {
            assert!(sentence.contains(word), "{word:?} is missing: {sentence}");
        }
    }
}

/// By how much caps are larger than on Linux: on Windows the system's libraries count, some 20 MiB under Wine.
pub(crate) const SYSTEM_MIB: u64 = if cfg!(windows) { 20 } else { 0 };

/// Arguments with the caps that this system needs. Caps below 6 MiB are too small everywhere.
fn with_caps<S: AsRef<OsStr>>(args: &[S]) -> Vec<OsString> {
    let mut args: Vec<OsString> = args.iter().map(|arg| arg.as_ref().to_owned()).collect();
    for at in (1..args.len()).filter(|_| cfg!(windows)) {
        let mib = args[at].to_str().and_then(|cap| cap.strip_suffix("MiB")?.parse::<f64>().ok());
        if let Some(mib) = mib.filter(|mib| args[at - 1] == "--memory" && (6.0..=24.0).contains(mib)) {
            args[at] = format!("{}MiB", mib + SYSTEM_MIB as f64).into();
        }
    }
    args
}

/// Runs `oct` with arguments. Builds without `--surface` or `--labels` are of skin voxels, since most tests count voxels;
/// [`shell`] runs builds of the default surface.
pub(crate) fn oct<S: AsRef<OsStr>>(args: &[S]) -> Run {
    let is_build =
        args.first().is_some_and(|first| ["build", "batch"].iter().any(|name| first.as_ref() == *name));
    let says = args
        .iter()
        .any(|arg| ["--surface", "--labels", "--help", "-h"].iter().any(|name| arg.as_ref() == *name));
    let skin: &[&str] = if is_build && !says { &["--surface", "skin"] } else { &[] };
    // Before what may follow two dashes.
    let args = with_caps(args);
    let (first, rest) = args.split_at(args.len().min(1));
    Run::of(&Command::new(binary()).args(first).args(skin).args(rest).stdin(Stdio::null()).output().unwrap())
}

/// Starts `oct` with arguments as they are; what it says on stderr is kept.
pub(crate) fn started<S: AsRef<OsStr>>(args: &[S]) -> Child {
    let mut command = Command::new(binary());
    command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// `oct build INPUTS -o OUTPUT EXTRA`.
pub(crate) fn build<P: AsRef<Path>>(inputs: &[P], output: &Path, extra: &[&str]) -> Run {
    let inputs = inputs.iter().map(|path| path.as_ref().as_os_str());
    let args = ["build".as_ref()].into_iter().chain(inputs).chain(["-o".as_ref(), output.as_os_str()]);
    oct(&args.chain(extra.iter().map(OsStr::new)).collect::<Vec<_>>())
}

/// Runs a shell script with `$OCT` the binary and `$1`, `$2` ... the arguments.
pub(crate) fn shell<S: AsRef<OsStr>>(script: &str, args: &[S]) -> Run {
    let mut command = Command::new("sh");
    command.arg("-c").arg(script).arg("sh").args(args).env("OCT", binary()).stdin(Stdio::null());
    Run::of(&command.output().unwrap())
}

/// Path as text, with `/` on every system.
pub(crate) fn text(path: &Path) -> String {
    let text = path.to_str().unwrap();
    if cfg!(windows) { text.replace('\\', "/") } else { text.to_owned() }
}

/// Names in a folder, hidden ones too, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| text(Path::new(&e.unwrap().file_name()))).collect();
    names.sort();
    names
}

/// The smallest budget that a refusal names, as it would be typed.
pub(crate) fn smallest_budget(refusal: &str) -> &str {
    let (_, after) = refusal.split_once(" is too small").expect(refusal);
    let (_, after) = after.split_once("--memory ").expect(refusal);
    after.split([',', ';', ' ', '\n']).next().unwrap()
}

/// Where GNU time may be; shells have a smaller `time` of their own.
fn gnu_time() -> Option<PathBuf> {
    let path = PathBuf::from("/usr/bin/time");
    let version = Command::new(&path).arg("--version").output().ok()?;
    let text = String::from_utf8_lossy(&[version.stdout, version.stderr].concat()).into_owned();
    text.contains("GNU").then_some(path)
}

/// Builds `input`; the report, and the peak in bytes that GNU time saw, where there is a GNU time.
pub(crate) fn measured_build(input: &Path, output: &Path, extra: &[&str]) -> (Value, Option<u64>) {
    let peak_file = output.with_extension("peak");
    let mut command = match gnu_time() {
        Some(time) => {
            let mut command = Command::new(time);
            command.args(["-f", "%M", "-o"]).arg(&peak_file).arg(binary());
            command
        }
        None => Command::new(binary()),
    };
    let args = ["build", &text(input), "-o", &text(output), "--json"];
    let skin: &[&str] = if extra.contains(&"--surface") { &[] } else { &["--surface", "skin"] };
    let done = command.args(args).args(skin).args(with_caps(extra)).stdin(Stdio::null()).output().unwrap();
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{input:?} {extra:?}: {stderr}");
    let peak = fs::read_to_string(&peak_file).ok().map(|kib| kib.trim().parse::<u64>().unwrap() * 1024);
    (serde_json::from_slice(&done.stdout).unwrap(), peak)
}
