//! What a command found, as lines of text or as one JSON object.

use serde_json::{Map, Value};

/// Names and values, in the order in which they are shown.
#[derive(Default)]
pub struct Report {
    entries: Vec<(&'static str, Value)>,
}

impl Report {
    /// Adds a value. A number that is not finite becomes `null`.
    pub fn with(mut self, name: &'static str, value: impl Into<Value>) -> Report {
        self.entries.push((name, value.into()));
        self
    }

    /// One line of JSON.
    pub fn json(self) -> String {
        let object: Map<String, Value> = self
            .entries
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value))
            .collect();
        format!("{}\n", Value::Object(object))
    }

    /// A line for every name that has a value; of a list or an object, a line for each entry.
    pub fn text(self) -> String {
        let longest = self
            .entries
            .iter()
            .map(|(name, _)| name.len())
            .max()
            .unwrap_or(0);
        let mut text = String::new();
        for (name, value) in self.entries {
            for value in lines(value) {
                text += &format!("{name:longest$}  {value}\n");
            }
        }
        text
    }
}

fn lines(value: Value) -> Vec<String> {
    match value {
        Value::Null => Vec::new(),
        Value::String(text) => vec![text],
        Value::Array(entries) if entries.iter().all(Value::is_number) => {
            vec![
                entries
                    .iter()
                    .map(Value::to_string)
                    .collect::<Vec<_>>()
                    .join(" "),
            ]
        }
        Value::Array(entries) => entries.into_iter().flat_map(lines).collect(),
        Value::Object(entries) => {
            let entry = |(name, value)| {
                lines(value)
                    .into_iter()
                    .map(move |v| format!("{name} = {v}"))
            };
            entries.into_iter().flat_map(entry).collect()
        }
        Value::Bool(_) | Value::Number(_) => vec![value.to_string()],
    }
}
