//! Python: constants, ctypes structures, results, and the arguments of `Engine`.

use super::NOTICE;
use super::interface::{Constant, Field, Group, Interface, Kind, Spelling, Structure, pascal, wrapped};

/// Groups that are classes; the others are dictionaries.
const CLASSES: [&str; 4] = ["Status", "Idle", "Attention", "Role"];
/// Structures whose values the package returns as tuples.
const RESULTS: [&str; 4] = ["latency", "stats", "received", "take_info"];
const WIDTH: usize = 110;

struct Python;

impl Spelling for Python {
    fn structure(&self, name: &str) -> String {
        if RESULTS.contains(&name) { format!("Raw{}", pascal(name)) } else { pascal(name) }
    }

    fn field(&self, name: &str) -> String {
        name.to_owned()
    }

    fn constant(&self, constant: &Constant) -> String {
        match constant.group() {
            None => constant.name.clone(),
            Some(group) if CLASSES.contains(&group.name) => format!("{}.{}", group.name, constant.member()),
            Some(_) => format!("\"{}\"", constant.member().to_lowercase()),
        }
    }

    fn group(&self, group: &Group, members: &[&Constant]) -> String {
        if CLASSES.contains(&group.name) {
            return group.name.to_owned();
        }
        let names: Vec<_> = members.iter().map(|member| self.constant(member)).collect();
        names.join("`, `")
    }
}

pub(crate) fn module(interface: &Interface) -> String {
    let mut out = format!("\"\"\"Constants and structures of umo.h. {NOTICE}\"\"\"\n");
    out += "
from __future__ import annotations

import enum
from collections.abc import Sequence
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_double, c_float, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from typing import TYPE_CHECKING, Any, NamedTuple, Optional

if TYPE_CHECKING:
    from ._model import Model

";
    for constant in interface.single() {
        out += &comment(interface, "", &constant.docs.join(" "));
        out += &format!("{} = {}\n", constant.name, constant.value);
    }
    for (group, members) in interface.groups() {
        out += &if CLASSES.contains(&group.name) { class(interface, group, &members) } else { table(group, &members) };
    }
    for structure in &interface.structures {
        out += &fields(interface, structure);
    }
    for name in RESULTS {
        out += &result(interface, interface.structure(name));
    }
    out + &arguments(interface, interface.structure("engine_config"))
}

fn comment(interface: &Interface, indent: &str, docs: &str) -> String {
    let docs = interface.translated(&[docs.to_owned()], &Python, None).concat();
    wrapped(&docs, WIDTH).iter().map(|line| format!("{indent}# {line}\n")).collect()
}

/// A docstring of one paragraph.
fn docstring(interface: &Interface, indent: &str, docs: &str, own: Option<&Structure>) -> String {
    let docs = interface.translated(&[docs.to_owned()], &Python, own).concat();
    let lines = wrapped(&docs, WIDTH);
    let end = if lines.len() > 1 { format!("\n{indent}") } else { String::new() };
    format!("{indent}\"\"\"{}{end}\"\"\"\n", lines.join(&format!("\n{indent}")))
}

fn class(interface: &Interface, group: &Group, members: &[&Constant]) -> String {
    let mut out = format!("\n\nclass {}(enum.IntEnum):\n    \"\"\"{}\"\"\"\n\n", group.name, group.doc);
    for member in members {
        out += &format!("    {} = {}\n", member.member(), member.value);
        out += &docstring(interface, "    ", &member.docs.join(" "), None);
    }
    out + "\n\n"
}

fn table(group: &Group, members: &[&Constant]) -> String {
    let entries: String = members
        .iter()
        .map(|member| format!("    \"{}\": {},\n", member.member().to_lowercase(), member.value))
        .collect();
    format!("# {}\n{}: dict[str, int] = {{\n{entries}}}\n", group.doc, group.table)
}

fn kind(field: &Field, structure: &Structure) -> String {
    match &field.kind {
        Kind::U32 => "c_uint32".into(),
        Kind::I32 => "c_int32".into(),
        Kind::U64 => "c_uint64".into(),
        Kind::F32 => "c_float".into(),
        Kind::F64 => "c_double".into(),
        Kind::Floats(count) => format!("c_float * {count}"),
        Kind::Pointer(pointer) => ctype(pointer),
        Kind::Function(..) => pascal(&structure.name) + &pascal(&field.name),
    }
}

fn ctype(name: &str) -> String {
    match name.replace("const", "").replace(' ', "").as_str() {
        "void" => "None".into(),
        "uint32_t" => "c_uint32".into(),
        "int32_t" => "c_int32".into(),
        "size_t" => "c_size_t".into(),
        "float" => "c_float".into(),
        "char*" => "c_char_p".into(),
        "void*" | "(*)" => "c_void_p".into(),
        pointer if pointer.ends_with('*') => format!("POINTER({})", ctype(&pointer[..pointer.len() - 1])),
        own if own.starts_with("structumo_") => Python.structure(&own["structumo_".len()..]),
        other => panic!("{other} has no type of ctypes"),
    }
}

fn fields(interface: &Interface, structure: &Structure) -> String {
    let mut out = String::new();
    for field in &structure.fields {
        if let Kind::Function(result, parameters) = &field.kind {
            let types: String = parameters.iter().map(|(kind, _)| format!(", {}", ctype(kind))).collect();
            out += &format!("\n{} = CFUNCTYPE({}{types})\n", kind(field, structure), ctype(result));
        }
    }
    out += &format!("\n\nclass {}(Structure):\n", Python.structure(&structure.name));
    out += &docstring(interface, "    ", &structure.docs.join(" "), Some(structure));
    out += "\n    _fields_ = [\n";
    for field in &structure.fields {
        out += &comment(interface, "        ", &field.docs.join(" "));
        out += &format!("        (\"{}\", {}),\n", field.name, kind(field, structure));
    }
    out += "    ]\n";
    let choices: Vec<_> = structure.fields.iter().filter_map(choice).collect();
    if !choices.is_empty() {
        let entries: String =
            choices.iter().map(|(name, group)| format!("        \"{name}\": {},\n", group.table)).collect();
        out += &format!("    # Names of the values of fields.\n    choices = {{\n{entries}    }}\n");
    }
    out
}

/// A field whose values have names, and the dictionary of these.
fn choice(field: &Field) -> Option<(&str, &'static Group)> {
    let group = field.group().filter(|group| !CLASSES.contains(&group.name) && matches!(field.kind, Kind::U32));
    group.map(|group| (field.name.as_str(), group))
}

fn result(interface: &Interface, structure: &Structure) -> String {
    let docs = structure.docs.join(" ");
    let (summary, _) = docs.split_once(" Set `struct_size`").unwrap_or((&docs, ""));
    let mut out = format!("\n\nclass {}(NamedTuple):\n    \"\"\"{summary}\"\"\"\n\n", pascal(&structure.name));
    for field in structure.numbers() {
        let kind = if matches!(field.kind, Kind::F32 | Kind::F64) { "float" } else { "int" };
        out += &format!("    {}: {kind}\n", field.name);
        out += &docstring(interface, "    ", &field.docs.join(" "), Some(structure));
    }
    out
}

/// Argument of a setting: its name, type, and comment.
fn argument(field: &Field) -> (&str, &'static str, String) {
    let docs = field.docs.join(" ");
    if let Some(name) = field.name.strip_suffix("_ms") {
        // Times are seconds in Python.
        return (name, "float", docs.replacen("milliseconds", "seconds", 1));
    }
    let kind = match field.kind {
        Kind::U32 if choice(field).is_some() => "str",
        Kind::F32 | Kind::F64 => "float",
        _ => "int",
    };
    (&field.name, kind, docs)
}

fn arguments(interface: &Interface, structure: &Structure) -> String {
    let mut out = String::from(
        "

class EngineArguments:
    \"\"\"Base of `Engine`: its arguments.\"\"\"

    def __init__(
        self,
        model: Optional[Model] = None,
        *,
        polled: bool = False,
        cores: Sequence[int] = (),
",
    );
    for field in structure.numbers() {
        let (name, kind, _) = argument(field);
        out += &format!("        {name}: Optional[{kind}] = None,\n");
    }
    out += "    ) -> None:\n        \"\"\"Makes an engine. What is None is the library's default.\n\n";
    for field in structure.numbers() {
        let (name, _, docs) = argument(field);
        let docs = interface.translated(&[format!("`{name}`: {docs}")], &Python, Some(structure)).concat();
        let lines = wrapped(&docs, WIDTH - 8);
        out += &format!("        - {}\n", lines.join("\n          "));
    }
    let values: Vec<_> = structure.numbers().map(|field| format!("{}={}", field.name, argument(field).0)).collect();
    out + &format!(
        "        \"\"\"
        self._make(model, polled, cores, {})

    def _make(self, model: Optional[Model], polled: bool, cores: Sequence[int], **settings: Any) -> None:
        raise NotImplementedError
",
        values.join(", ")
    )
}
