//! The schemas of all reports and the tables of `docs/JSON.md`, made from the types: the meaning of a key is the doc
//! comment of its field.

#![cfg(test)]

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::Path;

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use super::batch::{BatchReport, Item};
use super::build::BuildFigures;
use super::compare::CompareReport;
use super::demo::DemoFigures;
use super::export::ExportReport;
use super::info::InfoReport;
use super::intersect::IntersectReport;
use super::pack::PackReport;
use super::parts::{MergeReport, PartReport, PlanReport, StageReport};
use super::picture::PictureReport;
use super::pores::PoresReport;
use super::report::Report;
use super::scan::{Listed, ScanReport};
use super::thickness::ThicknessReport;
use super::verify::VerifyReport;
use crate::exit::ErrorReport;
use crate::render::selfcheck::Mismatches;

/// A report whose volumes are written one by one.
#[derive(JsonSchema)]
#[expect(dead_code, reason = "for its schema")]
struct List<R, V> {
    /// Reminder that paths are given in full and may identify the patient.
    notice: String,
    #[serde(flatten)]
    report: R,
    /// The volumes, in natural order of their paths.
    items: Vec<V>,
}

/// Name, title and schema of every report, in the order of the page.
fn schemas() -> Vec<(&'static str, &'static str, Value)> {
    vec![
        ("build", "`oct build --json`", schema::<BuildFigures>()),
        ("info", "`oct info --json`", schema::<InfoReport>()),
        ("verify", "`oct verify --json`", schema::<VerifyReport>()),
        ("plan", "`oct plan --json`", schema::<PlanReport>()),
        ("part", "`oct part --json`", schema::<PartReport>()),
        ("merge", "`oct merge --json`", schema::<MergeReport>()),
        ("merge-stage", "`oct merge --stage STAGE --json`", schema::<StageReport>()),
        ("pack", "`oct pack --json`, `oct unpack --json` and `oct strip --json`", schema::<PackReport>()),
        ("export", "`oct export --json`", schema::<ExportReport>()),
        ("intersect", "`oct intersect --json`", schema::<IntersectReport>()),
        ("compare", "`oct compare --json`", schema::<CompareReport>()),
        ("pores", "`oct pores --json`", schema::<PoresReport>()),
        ("thickness", "`oct thickness --json`", schema::<ThicknessReport>()),
        ("render", "`oct render --json` and `oct thumbnail --json`", schema::<PictureReport>()),
        ("scan", "`oct scan --json`", schema::<List<ScanReport, Listed>>()),
        ("batch", "`oct batch --json`, and its `report.json`", schema::<List<BatchReport, Item>>()),
        ("demo", "`oct demo --json`", schema::<DemoFigures>()),
        ("selfcheck", "`oct selfcheck --json`", schema::<Mismatches>()),
        ("report", "`oct report --json`, and its `report.json`", schema::<Report>()),
        (
            "error",
            "Errors: any command with `--json` that fails, but for a batch with failures",
            schema::<ErrorReport>(),
        ),
    ]
}

/// The schema of a type's output, without references and alternatives.
fn schema<T: JsonSchema>() -> Value {
    let settings = SchemaSettings::draft2020_12().for_serialize().with(|s| s.inline_subschemas = true);
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    simplify(&mut schema);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema
}

fn holds(list: &Value, key: &str) -> bool {
    list.as_array().is_some_and(|list| list.iter().any(|name| name == key))
}

fn simplify(schema: &mut Value) {
    let Value::Object(words) = schema else { return };
    for word in ["$schema", "title", "format", "maximum", "default"] {
        words.remove(word);
    }
    if let Some(Value::String(text)) = words.get_mut("description") {
        *text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    }
    if let Some(only) = words.remove("const") {
        words.insert("enum".into(), json!([only]));
    }
    // The items of a pair may have several types.
    if let Some(Value::Array(items)) = words.remove("prefixItems") {
        words.insert("items".into(), json!({ "anyOf": items }));
    }
    for word in ["anyOf", "oneOf"] {
        if let Some(Value::Array(alternatives)) = words.remove(word) {
            join(words, alternatives);
        }
    }
    let required = words.get("required").cloned().unwrap_or_default();
    for (key, member) in words.get_mut("properties").and_then(Value::as_object_mut).into_iter().flatten() {
        simplify(member);
        // An optional key is left out in place of null.
        if let (false, Value::Array(types)) = (holds(&required, key), &mut member["type"]) {
            types.retain(|name| name != "null");
            if let [only] = types.as_slice() {
                member["type"] = only.clone();
            }
        }
        if key.ends_with("_s") || key == "seconds" {
            let stages =
                member["properties"].as_object().map(|stages| stages.keys().cloned().collect::<Vec<_>>());
            for stage in stages.iter().flatten() {
                member["properties"][stage]["minimum"] = json!(0);
            }
            if stages.is_none() {
                member["minimum"] = json!(0);
            }
        }
    }
    if words.contains_key("properties") {
        words.insert("additionalProperties".into(), json!(false));
    }
    for word in ["items", "additionalProperties"] {
        if let Some(inner) = words.get_mut(word) {
            simplify(inner);
        }
    }
}

/// Alternatives as one schema of several types; the names of an enum are left to its description if it has objects,
/// too.
fn join(words: &mut Map<String, Value>, alternatives: Vec<Value>) {
    let (mut types, mut names, mut has_objects) = (Vec::new(), Vec::new(), false);
    for mut alternative in alternatives {
        simplify(&mut alternative);
        let Value::Object(mut own) = alternative else { continue };
        has_objects |= own.contains_key("properties") && !types.is_empty() && !names.is_empty();
        match own.remove("type") {
            Some(Value::Array(several)) => types.extend(several),
            one => types.extend(one),
        }
        match own.remove("enum") {
            Some(Value::Array(several)) => names.extend(several),
            _ if types.last() == Some(&json!("null")) && !names.is_empty() => names.push(Value::Null),
            _ => {}
        }
        let text = own.remove("description").unwrap_or_default();
        if let Some(Value::Object(mut properties)) = own.remove("properties") {
            // A variant is an object with one key, and its comment describes the object.
            let undescribed = properties.values_mut().filter_map(Value::as_object_mut);
            for member in undescribed {
                member.entry("description").or_insert(text.clone());
            }
            let all = words.entry("properties").or_insert(json!({}));
            all.as_object_mut().unwrap().extend(properties);
        }
        words.entry("description").or_insert(text);
        for (word, value) in own {
            words.entry(word).or_insert(value);
        }
    }
    if words["description"].is_null() {
        words.remove("description");
    }
    let mut seen = BTreeSet::new();
    types.retain(|name| seen.insert(name.as_str().unwrap().to_owned()));
    if has_objects {
        // Each alternative has keys of its own.
        words.remove("required");
    } else if !names.is_empty() {
        words.insert("enum".into(), names.into());
    }
    words.insert("type".into(), if types.len() == 1 { types.remove(0) } else { types.into() });
}

/// A line of a table for each key below a schema: key, types, meaning. Keys stand in the order in which they are
/// printed, optional ones last.
fn lines(schema: &Value, at: &str, into: &mut Vec<[String; 3]>) {
    let Some(members) = schema["properties"].as_object() else { return };
    let list = |word: &str| schema[word].as_array().into_iter().flatten().filter_map(Value::as_str);
    let required: Vec<&str> = list("required").collect();
    let optional = members.keys().map(String::as_str).filter(|key| !required.contains(key));
    for key in required.iter().copied().chain(optional) {
        let member = &members[key];
        let types = match &member["type"] {
            Value::Array(several) => {
                several.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(" or ")
            }
            one => one.as_str().unwrap().to_owned(),
        };
        let optional = if required.contains(&key) { "" } else { " (optional)" };
        let names = member["enum"].as_array().into_iter().flatten().filter_map(Value::as_str);
        let names = names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let meaning = member["description"].as_str().unwrap_or_default();
        let sentence = meaning.strip_suffix('.').filter(|rest| !rest.ends_with('.'));
        let mut meaning = sentence.unwrap_or(meaning).to_owned();
        if !names.is_empty() {
            let _ = write!(meaning, ": {names}");
        }
        into.push([format!("{at}{key}"), format!("{types}{optional}"), meaning]);
        lines(member, &format!("{at}{key}."), into);
        lines(&member["items"], &format!("{at}{key}[]."), into);
    }
}

const HEAD: &str = "\
# JSON reports

With `--json` a command prints one JSON object on stdout and nothing else. A key means the same in every command. \
Lengths are in millimetres (`_mm`), times in seconds (`_s`), sizes in bytes (`bytes`). Coordinates are in the \
patient's axes (LPS). `null` means unknown or not applicable; a key marked optional may be missing. Later versions may \
add keys, but do not remove any. Each table has a [JSON Schema](https://json-schema.org/) in the folder \
`docs/schema`; both are generated from the types that are printed.
";

/// The page with a table of every report.
fn page() -> String {
    let mut page = HEAD.to_owned();
    for (_, title, schema) in schemas() {
        let _ = write!(page, "\n## {title}\n\n| key | type | meaning |\n|---|---|---|\n");
        let mut all = Vec::new();
        lines(&schema, "", &mut all);
        for [key, types, meaning] in all {
            let _ = writeln!(page, "| `{key}` | {types} | {meaning} |");
        }
    }
    page
}

#[test]
fn the_schemas_and_the_page_are_those_of_the_types() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let mut due = BTreeMap::from([(docs.join("JSON.md"), page())]);
    for (name, title, mut schema) in schemas() {
        schema["title"] = json!(title);
        due.insert(docs.join(format!("schema/{name}.json")), format!("{schema:#}\n"));
    }
    if std::env::var_os("INFOBYTE_BLESS").is_some() {
        fs::create_dir_all(docs.join("schema")).unwrap();
        due.iter().for_each(|(path, text)| fs::write(path, text).unwrap());
    }
    let stale: Vec<_> =
        due.iter().filter(|(path, text)| fs::read_to_string(path).ok().as_ref() != Some(text)).collect();
    let names: Vec<_> = stale.iter().map(|(path, _)| path.display().to_string()).collect();
    assert!(names.is_empty(), "update with `INFOBYTE_BLESS=1 cargo test --lib jobs::schema`: {names:#?}");
    let files = fs::read_dir(docs.join("schema")).unwrap().count();
    assert_eq!(files + 1, due.len(), "docs/schema has a file that is not of any report");
}

#[test]
fn a_key_means_the_same_in_every_command() {
    let mut meanings: BTreeMap<String, BTreeMap<String, &str>> = BTreeMap::new();
    for (name, _, schema) in schemas() {
        let mut all = Vec::new();
        lines(&schema, "", &mut all);
        for [key, _, meaning] in all {
            assert!(!meaning.is_empty() && meaning.len() < 200, "{name}: {key} is not described: {meaning}");
            // The model of a batch's item has the keys of a build; a listed volume has the keys of a list.
            let key = key.strip_prefix("items[].model.").map_or(key.clone(), str::to_owned);
            if !key.contains('.') || key.starts_with("items[].") {
                meanings.entry(key).or_default().entry(meaning).or_insert(name);
            }
        }
    }
    // A batch's range is a list, which other programs rely on; a thumbnail there is a name in its folder. `selfcheck`
    // counts differing cells, measurements count all, both by the names of their contracts.
    let excepted = ["cells", "range", "thumbnail", "items[].reason", "items[].cause"];
    for (key, all) in meanings {
        assert!(all.len() == 1 || excepted.contains(&key.as_str()), "{key}: {all:#?}");
    }
}
