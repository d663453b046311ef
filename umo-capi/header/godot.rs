//! Godot: constants and structures in Rust, and the project's settings of engines.

use super::NOTICE;
use super::interface::{Constant, Field, Group, Interface, Kind, Spelling, Structure, pascal, wrapped};

struct Rust;

impl Spelling for Rust {
    fn structure(&self, name: &str) -> String {
        pascal(name)
    }

    fn field(&self, name: &str) -> String {
        name.to_owned()
    }

    fn constant(&self, constant: &Constant) -> String {
        constant.name.clone()
    }

    fn group(&self, group: &Group, _: &[&Constant]) -> String {
        format!("{}_…", group.prefix)
    }
}

pub(crate) fn module(interface: &Interface) -> String {
    let mut out = format!("//! Constants and structures of `umo.h`. {NOTICE}\n");
    out += "#![allow(dead_code, reason = \"all of the interface, whether it is used here or not\")]\n\n";
    out += "use std::ffi::{c_char, c_void};\n\n";
    for constant in &interface.constants {
        let kind = match constant.group() {
            Some(group) if group.name == "Status" => "i32",
            _ if constant.is_count() => "usize",
            _ => "u32",
        };
        out += &comment(interface, "", &constant.docs.join(" "), None);
        out += &format!("pub(crate) const {}: {kind} = {};\n", constant.name, constant.value);
    }
    for structure in &interface.structures {
        out += &layout(interface, structure);
    }
    out + &settings(interface.structure("engine_config"))
}

fn comment(interface: &Interface, indent: &str, docs: &str, own: Option<&Structure>) -> String {
    let docs = interface.translated(&[docs.to_owned()], &Rust, own).concat();
    wrapped(&docs, 100).iter().map(|line| format!("{indent}/// {line}\n")).collect()
}

fn layout(interface: &Interface, structure: &Structure) -> String {
    let has_pointers = structure.fields.iter().any(|field| matches!(field.kind, Kind::Pointer(_) | Kind::Function(..)));
    let mut out = String::from("\n") + &comment(interface, "", &structure.docs.join(" "), Some(structure));
    let default = if has_pointers { "" } else { ", Default" };
    out += &format!("#[repr(C)]\n#[derive(Clone, Copy{default})]\n");
    out += &format!("pub(crate) struct {} {{\n", pascal(&structure.name));
    for field in &structure.fields {
        out += &comment(interface, "    ", &field.docs.join(" "), Some(structure));
        out += &format!("    pub(crate) {}: {},\n", field.name, kind(field));
    }
    out + "}\n"
}

fn kind(field: &Field) -> String {
    match &field.kind {
        Kind::U32 => "u32".to_owned(),
        Kind::I32 => "i32".to_owned(),
        Kind::U64 => "u64".to_owned(),
        Kind::F32 => "f32".to_owned(),
        Kind::F64 => "f64".to_owned(),
        Kind::Floats(count) => format!("[f32; {count}]"),
        Kind::Pointer(pointer) => ctype(pointer),
        // None is called here.
        Kind::Function(..) => "*const c_void".to_owned(),
    }
}

/// A type of C in Rust.
fn ctype(name: &str) -> String {
    let name = name.trim();
    let Some(inner) = name.strip_suffix('*') else {
        return match name {
            "void" => "c_void".to_owned(),
            "char" => "c_char".to_owned(),
            "float" => "f32".to_owned(),
            "uint32_t" => "u32".to_owned(),
            "int32_t" => "i32".to_owned(),
            own => pascal(own.strip_prefix("struct umo_").expect("a type that the generator knows")),
        };
    };
    let inner = inner.trim();
    if let Some(inner) = inner.strip_suffix("const") {
        return format!("*const {}", ctype(inner));
    }
    match inner.strip_prefix("const ").filter(|pointee| !pointee.contains('*')) {
        Some(pointee) => format!("*const {}", ctype(pointee)),
        None => format!("*mut {}", ctype(inner)),
    }
}

fn settings(structure: &Structure) -> String {
    let mut out = String::from(
        "
impl EngineConfig {
    /// Sets what a project sets: numbers by their names. 0 is the library's default.
    pub(crate) fn set(&mut self, setting: impl Fn(&str) -> u32) {
        let set = |name, field: &mut u32| match setting(name) {
            0 => {}
            value => *field = value,
        };
",
    );
    for field in structure.numbers() {
        assert!(matches!(field.kind, Kind::U32), "{}: settings of engines are whole numbers so far", field.name);
        out += &format!("        set(\"umo/{}\", &mut self.{});\n", field.name, field.name);
    }
    out + "    }\n}\n"
}
