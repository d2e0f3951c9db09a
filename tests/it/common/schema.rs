//! A small checker of JSON Schema: the words that the schemas of this project use, and no others.

use serde_json::{Map, Value};

/// Words that a schema may use. An unknown one would be ignored, and so check nothing.
const WORDS: &str = "$schema title description type properties required additionalProperties items minItems \
    maxItems enum minimum";

/// Everything in a value that a schema does not allow, each with its place.
pub(crate) fn faults(schema: &Value, value: &Value) -> Vec<String> {
    let mut found = Vec::new();
    check(schema, value, "", &mut found);
    found
}

fn check(schema: &Value, value: &Value, at: &str, found: &mut Vec<String>) {
    let words = schema.as_object().unwrap_or_else(|| panic!("{at}: the schema is not an object"));
    if let Some(word) = words.keys().find(|word| !WORDS.split(' ').any(|known| known == *word)) {
        panic!("{at}: the word `{word}` is not known");
    }
    let mut wrong = |text: String| found.push(format!("{}: {text}", if at.is_empty() { "." } else { at }));
    let types: Vec<&str> = match &words["type"] {
        Value::String(one) => vec![one.as_str()],
        Value::Array(several) => several.iter().filter_map(Value::as_str).collect(),
        other => panic!("{at}: {other} is not a type"),
    };
    if !types.iter().any(|name| is(value, name)) {
        wrong(format!("{value} is no {}", types.join(" or ")));
        return;
    }
    if let Some(Value::Array(choices)) = words.get("enum")
        && !choices.contains(value)
    {
        wrong(format!("{value} is none of {choices:?}"));
    }
    if let (Some(least), Some(number)) = (words.get("minimum").and_then(Value::as_f64), value.as_f64())
        && number < least
    {
        wrong(format!("{number} is below {least}"));
    }
    match value {
        Value::Object(members) => {
            for name in words.get("required").and_then(Value::as_array).into_iter().flatten() {
                if !members.contains_key(name.as_str().unwrap()) {
                    wrong(format!("{name} is missing"));
                }
            }
            let none = Map::new();
            let known = words.get("properties").and_then(Value::as_object).unwrap_or(&none);
            for (name, member) in members {
                let at = format!("{at}.{name}");
                match known.get(name).or_else(|| words.get("additionalProperties")) {
                    Some(Value::Bool(false)) | None => found.push(format!("{at}: is not described")),
                    Some(schema) => check(schema, member, &at, found),
                }
            }
        }
        Value::Array(items) => {
            let bound = |word: &str| words.get(word).and_then(Value::as_u64);
            let count = items.len() as u64;
            if bound("minItems").is_some_and(|least| count < least)
                || bound("maxItems").is_some_and(|most| count > most)
            {
                wrong(format!("has {count} items"));
            }
            for (i, item) in items.iter().enumerate() {
                check(&words["items"], item, &format!("{at}[{i}]"), found);
            }
        }
        _ => {}
    }
}

fn is(value: &Value, name: &str) -> bool {
    match name {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        other => panic!("{other} is not a type"),
    }
}
