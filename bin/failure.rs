//! Reasons for the command to end without success, and their report: one sentence on stderr, and under `--json` one
//! object on stdout as well.

use std::fmt;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use infobyte::export::ExportForm;
use infobyte::text::{self, shown};
use infobyte::{Error, ErrorReport, ExitKind};

/// Reason for the command to end without success.
pub(crate) enum Failure {
    /// Its arguments do not belong together.
    Arguments(Refusal),
    /// The library's error.
    Job(Error),
}

/// Refusal of the arguments, whatever the files contain.
pub(crate) enum Refusal {
    SkipAlone,
    NoDims,
    NoType,
    /// A flag for volumes, and the input is a mesh.
    ForVolumes(&'static str),
    /// A flag that does not apply to a tree of solids.
    ForOthers(&'static str),
    /// A tree of solids among other inputs.
    SeveralTrees,
    /// A flag for meshes or trees, and the input is a volume.
    ForMeshes(&'static str),
    /// Standard input, or output, where it cannot be used.
    Dash(Dash),
    /// Words of a plan that its file of JSON cannot hold.
    NotText,
    /// A name that does not tell the form of an export.
    NoForm {
        path: PathBuf,
    },
    /// A name that belongs to another form than the one that was chosen.
    OtherForm {
        path: PathBuf,
        form: ExportForm,
    },
    /// An option that the output does not support.
    NotOf {
        flag: &'static str,
        of: &'static str,
    },
    /// An option that has no effect without another one.
    Without {
        flag: &'static str,
        with: &'static str,
    },
    /// A suffix of another kind of file than the output's.
    Suffix {
        path: PathBuf,
        written: Written,
    },
}

/// Uses of `-` that are refused.
#[derive(Clone, Copy)]
pub(crate) enum Dash {
    /// Input of a volume that states its own size.
    Volume,
    /// One of several input files.
    AmongFiles,
    /// A path to be searched.
    Search,
    /// Output of a build.
    Model,
    /// A folder, or another file.
    Folder,
    /// A second picture.
    Layer,
    /// Output and report at once.
    WithJson,
    /// Output on a terminal.
    Terminal,
}

/// Kind of the output.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Written {
    Model,
    Picture,
    Turntable,
    Export,
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::Arguments(refusal)
    }
}

impl From<Dash> for Failure {
    fn from(dash: Dash) -> Self {
        Self::Arguments(Refusal::Dash(dash))
    }
}

impl From<Error> for Failure {
    fn from(cause: Error) -> Self {
        Self::Job(cause)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Job(cause) => cause.fmt(f),
            Self::Arguments(refusal) => refusal.fmt(f),
        }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SkipAlone => {
                "--skip is for raw volumes, with --dims and --dtype; other files say where their voxels begin"
            }
            Self::NoDims => "a raw volume needs --dims NXxNYxNZ as well",
            Self::NoType => "a raw volume needs --dtype as well, for example --dtype u16",
            Self::ForVolumes("--dims") => {
                "--dims of a mesh needs --voxel and --origin as well; --grid N alone chooses all of them"
            }
            Self::ForVolumes(flag) => {
                return write!(f, "{flag} is for volumes, and the input is a mesh; leave it out");
            }
            Self::ForOthers("--dims") => {
                "--dims of a tree needs --voxel and --origin as well; --grid N alone chooses all of them"
            }
            Self::ForOthers(flag @ ("--fill" | "--keep-thin")) => {
                return write!(f, "{flag} is for meshes, and the input is a tree of solids; leave it out");
            }
            Self::ForOthers(flag) => {
                return write!(f, "{flag} is for volumes, and the input is a tree of solids; leave it out");
            }
            Self::SeveralTrees => {
                "a tree of solids (.csg) is built by itself; join several by union() { ... } in one file, and meshes by import()"
            }
            Self::ForMeshes(flag) => {
                return write!(
                    f,
                    "{flag} is for meshes (STL, PLY, OBJ, OFF, glTF, 3MF) and trees (.csg), and the input is a volume; leave it out"
                );
            }
            Self::Dash(dash) => match dash {
                Dash::Volume => {
                    "standard input (-) is read as headerless voxels only; add --dims and --dtype, or name a file"
                }
                Dash::AmongFiles => "standard input (-) cannot be one of several inputs; name files",
                Dash::Search => "standard input (-) cannot be searched; name files and folders",
                Dash::Model => {
                    "a model is put in its place whole and cannot go to standard output (-); name a file"
                }
                Dash::Folder => "standard output (-) cannot take several files; name a folder",
                Dash::Layer => "only one picture can go to standard output (-), that of --output; name a file",
                Dash::WithJson => {
                    "standard output cannot take both the file (-o -) and the report (--json); name a file"
                }
                Dash::Terminal => "the output is not for a terminal; send it into a file or another command",
            },
            Self::NotText => "a plan holds paths and options as Unicode text, and one of them is not; rename the file or folder",
            Self::NoForm { path } => {
                return write!(
                    f,
                    "{}: does not say what to write; name it .stl, .ply, .obj, .glb, .3mf, .nrrd, .nii, .nii.gz or .html, or choose with --as",
                    shown(path)
                );
            }
            Self::OtherForm { path, form } => {
                return write!(
                    f,
                    "{}: is named as another kind of file, and {} would be written; name it .{}, or add --force",
                    shown(path),
                    form.name(),
                    form.suffix()
                );
            }
            Self::Without { flag, with } => {
                return write!(f, "{flag} changes nothing without {with}; add that, or leave {flag} out");
            }
            Self::NotOf { flag, of } => return write!(f, "{flag} is for {of}; leave it out"),
            Self::Suffix { path, written } => {
                let (this, other) = match written {
                    Written::Model => ("a model", "MODEL.oct"),
                    Written::Picture => ("a PNG picture", "IMAGE.png"),
                    Written::Turntable => ("an animation", "TURN.png or TURN.gif"),
                    Written::Export => ("an export", "FILE.stl"),
                };
                return write!(
                    f,
                    "{}: is named as another kind of file, and {this} would be written; name it {other}, or add --force",
                    shown(path)
                );
            }
        })
    }
}

impl Failure {
    /// Kind of the exit code.
    pub(crate) fn kind(&self) -> ExitKind {
        match self {
            Self::Arguments(_) => ExitKind::Usage,
            Self::Job(cause) => cause.kind(),
        }
    }
}

/// Reports a failure on stderr, and as an object on stdout if that was asked for. There may be no listener.
pub(crate) fn tell(sentence: &str, kind: ExitKind, as_json: bool) -> ExitCode {
    let sentence = one_line(sentence);
    if as_json {
        let _ = writeln!(io::stdout(), "{}", text::json(&ErrorReport::new(&sentence, kind)));
    }
    let _ = writeln!(io::stderr(), "oct: {sentence}");
    ExitCode::from(kind.code())
}

/// The text on one line, whatever a file's name contains.
pub(crate) fn one_line(text: &str) -> String {
    shown(text).to_string()
}
