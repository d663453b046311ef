//! JSON that is edited in some places and preserved verbatim in all others.

use std::fmt;

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;

/// The members of an object in file order, each as its source text.
#[derive(Debug, Default)]
pub struct Members(pub Vec<(String, Box<RawValue>)>);

impl<'de> Deserialize<'de> for Members {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Seen;

        impl<'de> Visitor<'de> for Seen {
            type Value = Members;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Members, M::Error> {
                let mut members = Vec::new();
                while let Some(member) = map.next_entry()? {
                    members.push(member);
                }
                Ok(Members(members))
            }
        }

        deserializer.deserialize_map(Seen)
    }
}

/// Serialises a value.
pub fn raw(value: &serde_json::Value) -> Box<RawValue> {
    serde_json::value::to_raw_value(value).expect("a JSON value can be written")
}

impl Members {
    /// Parses an object.
    pub fn parse(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    /// Replaces the member of that name, or appends one.
    pub fn set(&mut self, name: &str, value: Box<RawValue>) {
        match self.0.iter_mut().find(|(known, _)| known == name) {
            Some((_, slot)) => *slot = value,
            None => self.0.push((name.to_owned(), value)),
        }
    }

    /// Whether there is a member of that name.
    pub fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(known, _)| known == name)
    }

    /// Removes a member.
    pub fn remove(&mut self, name: &str) {
        self.0.retain(|(known, _)| known != name);
    }

    /// Removes members with these names from a member that is an object, or these strings from one that is a list. A
    /// member that is empty afterwards is removed.
    pub fn prune(&mut self, name: &str, gone: &[&str]) -> Result<(), String> {
        let Some((_, value)) = self.0.iter_mut().find(|(known, _)| known == name) else { return Ok(()) };
        let is_empty = if value.get().starts_with('[') {
            let mut texts: Vec<String> =
                serde_json::from_str(value.get()).map_err(|error| format!("`{name}`: {error}"))?;
            texts.retain(|text| !gone.contains(&text.as_str()));
            *value = raw(&texts.clone().into());
            texts.is_empty()
        } else {
            let mut object = Self::parse(value.get())?;
            object.0.retain(|(known, _)| !gone.contains(&known.as_str()));
            let is_empty = object.0.is_empty();
            *value = object.into_raw();
            is_empty
        };
        if is_empty {
            self.remove(name);
        }
        Ok(())
    }

    /// Returns the elements of a list member; empty if the member does not exist.
    pub fn list(&self, name: &str) -> Result<Vec<Box<RawValue>>, String> {
        match self.0.iter().find(|(known, _)| known == name) {
            Some((_, list)) => serde_json::from_str(list.get()).map_err(|error| format!("`{name}`: {error}")),
            None => Ok(Vec::new()),
        }
    }

    /// Sets a list member.
    pub fn set_list(&mut self, name: &str, elements: &[Box<RawValue>]) {
        let text: Vec<_> = elements.iter().map(|element| element.get()).collect();
        let text = format!("[{}]", text.join(","));
        self.set(name, RawValue::from_string(text).expect("a list of JSON values is JSON"));
    }

    /// Serialises the object.
    pub fn text(&self) -> String {
        let name = |name: &str| serde_json::Value::from(name).to_string();
        let members: Vec<_> = self.0.iter().map(|(key, value)| format!("{}:{}", name(key), value.get())).collect();
        format!("{{{}}}", members.join(","))
    }

    /// Serialises the object as a raw value.
    pub fn into_raw(self) -> Box<RawValue> {
        RawValue::from_string(self.text()).expect("an object of JSON values is JSON")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn untouched_json_keeps_its_bytes() {
        let text = r#"{ "a" : [1.50, {"x" : 1e-3 }], "ü\"" : "\u00e9",  "b":12345678901234567890 }"#;
        let mut object = Members::parse(text).unwrap();
        assert_eq!(object.text(), r#"{"a":[1.50, {"x" : 1e-3 }],"ü\"":"\u00e9","b":12345678901234567890}"#);
        let mut list = object.list("a").unwrap();
        list.push(raw(&serde_json::json!({"n": 1})));
        object.set_list("a", &list);
        object.remove("b");
        object.set("c", raw(&true.into()));
        assert_eq!(object.text(), r#"{"a":[1.50,{"x" : 1e-3 },{"n":1}],"ü\"":"\u00e9","c":true}"#);
        object.set("used", raw(&serde_json::json!(["x", "y"])));
        object.prune("used", &["x"]).unwrap();
        assert!(object.text().ends_with(r#""used":["y"]}"#));
        object.prune("used", &["y"]).unwrap();
        object.set("extensions", raw(&serde_json::json!({"x": 1, "z": 2})));
        object.prune("extensions", &["x"]).unwrap();
        assert!(object.text().ends_with(r#""c":true,"extensions":{"z":2}}"#));
        assert!(object.list("none").unwrap().is_empty());
        assert!(object.list("c").is_err() && Members::parse("[1]").is_err());
    }
}
