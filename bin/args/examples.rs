//! Two examples below the help of each command, as they would be typed.

pub(crate) const BUILD: &str = "Examples:
  oct build ct-series/ -o head.oct --preset bone --keep-largest 1
  oct build scan.raw -o scan.oct --dims 512x512x300 --dtype u16 --spacing 0.5x0.5x1 --iso 300 --memory 8MiB";

pub(crate) const BATCH: &str = "Examples:
  oct batch studies/ --out models/
  oct batch studies/ --out models/ --modality CT --preset bone --memory 256MiB --jobs 4";

pub(crate) const SCAN: &str = "Examples:
  oct scan studies/
  oct scan studies/ --json";

pub(crate) const PLAN: &str = "Examples:
  oct plan scan.nrrd --iso 300 --parts 64 --out job/
  oct plan ct-series/ --preset bone --surface skin --parts 8 --out job/";

pub(crate) const PART: &str = "Examples:
  oct part job/plan.json 0
  oct part job/plan.json 63 --memory 16MiB --threads 1 --scratch /tmp";

pub(crate) const MERGE: &str = "Examples:
  oct merge job/plan.json -o whole.oct
  oct merge job/plan.json -o whole.oct --json";

pub(crate) const INFO: &str = "Examples:
  oct info head.oct
  oct info head.oct --json";

pub(crate) const VERIFY: &str = "Examples:
  oct verify head.oct
  oct verify - --json";

pub(crate) const PACK: &str = "Examples:
  oct pack head.oct -o head-packed.oct
  oct pack head.oct -o -";

pub(crate) const UNPACK: &str = "Examples:
  oct unpack head-packed.oct -o head.oct
  oct unpack - -o head.oct";

pub(crate) const STRIP: &str = "Examples:
  oct strip head.oct -o shape.oct --channels none
  oct strip head.oct -o small.oct --levels 2";

pub(crate) const EXPORT: &str = "Examples:
  oct export jaw.oct -o jaw.stl
  oct export organs.oct --each organs --as obj";

pub(crate) const INTERSECT: &str = "Examples:
  oct intersect jaw.oct implant.oct
  oct intersect jaw.oct implant.oct --move 12.5,-3,40";

pub(crate) const COMPARE: &str = "Examples:
  oct compare scan.oct drawing.stl --fit --tolerance 0.2 -o deviation.oct
  oct compare new.oct old.oct --csv deviations.csv --json";

pub(crate) const THICKNESS: &str = "Examples:
  oct thickness print.oct --thin 0.8 -o thickness.oct
  oct thickness bone.oct --by ball --max 6 --csv thickness.csv";

pub(crate) const PORES: &str = "Examples:
  oct pores casting.oct --csv pores.csv
  oct pores print.oct --bodies --least 100";

pub(crate) const VIEW: &str = "Examples:
  oct view models/
  oct view head.oct --port 8080 --idle 600";

pub(crate) const RENDER: &str = "Examples:
  oct render head.oct -o head.png --view left --size 1600x1200
  oct render head.oct -o head.png --projection perspective --eye 0,-600,120 --look-at 0,0,0";

pub(crate) const THUMBNAIL: &str = "Examples:
  oct thumbnail head.oct -o head.png
  oct thumbnail head.oct -o - --size 128";

pub(crate) const DEMO: &str = "Examples:
  oct demo
  oct demo -o skin.oct --size 256 --iso -400";

pub(crate) const SELFCHECK: &str = "Examples:
  oct selfcheck head.oct
  oct selfcheck head.oct --rays 10000000 --seed 7";

pub(crate) const REPORT: &str = "Examples:
  oct report --synthetic suite --out report/
  oct report head.oct --out report/";

pub(crate) const COMPLETIONS: &str = "Examples:
  oct completions bash
  oct completions zsh";

pub(crate) const MAN: &str = "Examples:
  oct man man/
  oct man ~/.local/share/man/man1";
