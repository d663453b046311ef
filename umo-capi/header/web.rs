//! JavaScript: constants, and where the fields of structures are in WebAssembly; the types of these for TypeScript.

use super::NOTICE;
use super::interface::{Constant, Field, Group, Interface, Kind, Spelling, Structure, camel, pascal, wrapped};

/// Groups whose values users write as numbers; the values of the others have names.
const NUMBERS: [&str; 4] = ["Parameter", "Mood", "Attention", "Idle"];
/// Configurations, and the interfaces of what users set of them.
const OPTIONS: [(&str, &str); 2] = [("engine_config", "EngineOptions"), ("session_config", "SessionOptions")];

struct JavaScript;

impl Spelling for JavaScript {
    fn structure(&self, name: &str) -> String {
        OPTIONS.iter().find(|(own, _)| *own == name).map_or_else(|| pascal(name), |(_, options)| (*options).to_owned())
    }

    fn field(&self, name: &str) -> String {
        camel(name)
    }

    fn constant(&self, constant: &Constant) -> String {
        match constant.group() {
            None => constant.name.clone(),
            Some(group) if NUMBERS.contains(&group.name) => format!("{}.{}", group.name, member(constant)),
            Some(_) => format!("\"{}\"", member(constant)),
        }
    }

    fn group(&self, group: &Group, members: &[&Constant]) -> String {
        if NUMBERS.contains(&group.name) {
            return group.name.to_owned();
        }
        let names: Vec<_> = members.iter().map(|member| self.constant(member)).collect();
        names.join("`, `")
    }
}

/// Name of a constant in its group: those of errors are as in C.
fn member(constant: &Constant) -> String {
    match constant.group() {
        Some(group) if group.name == "Status" => constant.name["STATUS_".len()..].to_owned(),
        _ => camel(constant.member()),
    }
}

/// `generated.js`.
pub(crate) fn module(interface: &Interface) -> String {
    let mut out = format!("// Constants and structures of umo.h. {NOTICE}\n\n");
    for constant in interface.single() {
        out += &comment(interface, "", &constant.docs.join(" "), None);
        out += &format!("export const {} = {};\n", constant.name, constant.value);
    }
    for (group, members) in interface.groups() {
        let name = if NUMBERS.contains(&group.name) { group.name } else { group.table };
        out += &format!("/** {} */\nexport const {name} = Object.freeze({{\n", group.doc);
        for constant in members {
            out += &comment(interface, "  ", &constant.docs.join(" "), None);
            out += &format!("  {}: {},\n", member(constant), constant.value);
        }
        out += "});\n";
    }
    out += "\n// Structures where pointers have 32 bits: bytes; and of each field the offset, the type, and the names of its values.\n";
    for structure in &interface.structures {
        out += &layout(structure);
    }
    out
}

/// `generated.d.ts`: what users see.
pub(crate) fn types(interface: &Interface) -> String {
    let mut out = format!("// Constants and options of umo.h. {NOTICE}\n\n");
    for (group, members) in interface.groups().filter(|(group, _)| NUMBERS.contains(&group.name)) {
        out += &format!("/** {} */\nexport const {}: Readonly<{{\n", group.doc, group.name);
        for constant in members {
            out += &comment(interface, "  ", &constant.docs.join(" "), None);
            out += &format!("  {}: {};\n", member(constant), constant.value);
        }
        out += "}>;\n";
    }
    for (name, options) in OPTIONS {
        let structure = interface.structure(name);
        out += &format!("\nexport interface {options} {{\n");
        for field in structure.numbers() {
            out += &comment(interface, "  ", &field.docs.join(" "), Some(structure));
            out += &format!("  {}?: {};\n", camel(&field.name), option(interface, field));
        }
        out += "}\n";
    }
    let received = interface.structure("received");
    out += "\n/** Statistics of a decoder's packets. */\nexport interface Received {\n";
    for field in received.numbers() {
        out += &comment(interface, "  ", &field.docs.join(" "), Some(received));
        out += &format!("  {}: number;\n", camel(&field.name));
    }
    out + "}\n"
}

fn comment(interface: &Interface, indent: &str, docs: &str, own: Option<&Structure>) -> String {
    let docs = interface.translated(&[docs.to_owned()], &JavaScript, own).concat();
    match &wrapped(&docs, 120)[..] {
        [line] => format!("{indent}/** {line} */\n"),
        lines => {
            let lines: String = lines.iter().map(|line| format!("{indent} * {line}\n")).collect();
            format!("{indent}/**\n{lines}{indent} */\n")
        }
    }
}

/// Type of an option.
fn option(interface: &Interface, field: &Field) -> String {
    let named = field.group().filter(|group| !NUMBERS.contains(&group.name));
    match (&field.kind, named) {
        (Kind::U64, _) => "number | bigint".to_owned(),
        (_, None) => "number".to_owned(),
        (_, Some(group)) => {
            let names: Vec<_> = interface.members(group).iter().map(|own| JavaScript.constant(own)).collect();
            names.join(" | ")
        }
    }
}

fn layout(structure: &Structure) -> String {
    let (size, offsets) = structure.layout(4);
    let mut out = format!("export const {} = {{\n  size: {size},\n", structure.name.to_uppercase());
    out += "  fields: {\n";
    for (field, offset) in structure.fields.iter().zip(offsets) {
        let kind = match field.kind {
            Kind::U32 => "Uint32",
            Kind::I32 => "Int32",
            Kind::U64 => "BigUint64",
            Kind::F32 | Kind::Floats(_) => "Float32",
            Kind::F64 => "Float64",
            Kind::Pointer(_) | Kind::Function(..) => "Pointer",
        };
        let named = field.group().filter(|group| !NUMBERS.contains(&group.name) && matches!(field.kind, Kind::U32));
        let names = named.map_or(String::new(), |group| format!(", {}", group.table));
        out += &format!("    {}: [{offset}, \"{kind}\"{names}],\n", camel(&field.name));
    }
    out += "  },\n";
    if OPTIONS.iter().any(|(name, _)| *name == structure.name) {
        let names: Vec<_> = structure.numbers().map(|field| format!("\"{}\"", camel(&field.name))).collect();
        out += &format!("  options: [{}],\n", names.join(", "));
    }
    out + "};\n"
}
