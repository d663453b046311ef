//! C#: constants and structures, and the settings of Unity's engines.

use super::NOTICE;
use super::interface::{Constant, Field, Group, Interface, Kind, Spelling, Structure, pascal, wrapped};

struct CSharp;

impl Spelling for CSharp {
    fn structure(&self, name: &str) -> String {
        pascal(name)
    }

    fn field(&self, name: &str) -> String {
        pascal(name)
    }

    fn constant(&self, constant: &Constant) -> String {
        let owner = constant.group().map_or("Native", |group| group.name);
        format!("{owner}.{}", pascal(constant.member()))
    }

    fn group(&self, group: &Group, _: &[&Constant]) -> String {
        group.name.to_owned()
    }
}

/// `Generated.cs` of the C# layer.
pub(crate) fn native(interface: &Interface) -> String {
    let mut out = head("using System;\nusing System.Runtime.InteropServices;\n", "Umo");
    out += "    public static unsafe partial class Native\n    {\n";
    for constant in interface.single() {
        let kind = if constant.is_count() { "int" } else { "uint" };
        out += &summary(interface, "        ", &constant.docs.join(" "), None);
        out += &format!("        public const {kind} {} = {};\n", pascal(&constant.name), constant.value);
    }
    out += "    }\n";
    for (group, members) in interface.groups() {
        out += &enumeration(interface, group, &members);
    }
    for structure in &interface.structures {
        for field in &structure.fields {
            out += &delegate(interface, structure, field);
        }
        out += &layout(interface, structure);
    }
    out + "}\n"
}

/// `UmoRuntime.Generated.cs` of the Unity package.
pub(crate) fn runtime(interface: &Interface) -> String {
    let structure = interface.structure("engine_config");
    let mut out = head("", "Umo.Unity");
    out += "    public static partial class UmoRuntime\n    {\n";
    for field in structure.numbers() {
        out += &summary(interface, "        ", &field.docs.join(" "), Some(structure));
        out += &format!("        public static {} {} {{ get; set; }}\n\n", kind(field), pascal(&field.name));
    }
    out += "        private static void Configure(ref EngineConfig config)\n        {\n";
    for field in structure.numbers() {
        let name = pascal(&field.name);
        out += &format!("            if ({name} != 0) config.{name} = {name};\n");
    }
    out + "        }\n    }\n}\n"
}

fn head(using: &str, namespace: &str) -> String {
    let using = if using.is_empty() { String::new() } else { format!("{using}\n") };
    format!("// SPDX-License-Identifier: MIT OR Apache-2.0\n// {NOTICE}\n\n{using}namespace {namespace}\n{{\n")
}

/// A comment of XML.
fn summary(interface: &Interface, indent: &str, docs: &str, own: Option<&Structure>) -> String {
    let docs = interface.translated(&[docs.to_owned()], &CSharp, own).concat();
    let docs = docs.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('`', "");
    let lines = wrapped(&docs, 110);
    match &lines[..] {
        [line] => format!("{indent}/// <summary>{line}</summary>\n"),
        lines => {
            let lines: String = lines.iter().map(|line| format!("{indent}/// {line}\n")).collect();
            format!("{indent}/// <summary>\n{lines}{indent}/// </summary>\n")
        }
    }
}

fn enumeration(interface: &Interface, group: &Group, members: &[&Constant]) -> String {
    let mut out = String::from("\n") + &summary(interface, "    ", group.doc, None);
    if group.is_bits {
        out += "    [Flags]\n";
    }
    let kind = if members.iter().any(|member| member.value < 0) { "int" } else { "uint" };
    out += &format!("    public enum {} : {kind}\n    {{\n", group.name);
    for member in members {
        out += &summary(interface, "        ", &member.docs.join(" "), None);
        out += &format!("        {} = {},\n", pascal(member.member()), member.value);
    }
    out + "    }\n"
}

/// Type of a field; a pointer is an `IntPtr`.
fn kind(field: &Field) -> String {
    match &field.kind {
        Kind::U32 => field.group().map_or("uint", |group| group.name).to_owned(),
        Kind::I32 => "int".to_owned(),
        Kind::U64 => "ulong".to_owned(),
        Kind::F32 => "float".to_owned(),
        Kind::F64 => "double".to_owned(),
        Kind::Floats(_) => "fixed float".to_owned(),
        Kind::Pointer(_) | Kind::Function(..) => "IntPtr".to_owned(),
    }
}

/// The type of a field that points to a function.
fn delegate(interface: &Interface, structure: &Structure, field: &Field) -> String {
    let Kind::Function(result, parameters) = &field.kind else { return String::new() };
    let own = |kind: &str| match kind {
        "void" => "void",
        "int32_t" => "int",
        "uint32_t" => field.group().map_or("uint", |group| group.name),
        "size_t" => "UIntPtr",
        pointer if pointer.ends_with('*') || pointer == "(*)" => "IntPtr",
        other => panic!("{other} has no type of C#"),
    };
    let parameters: Vec<_> = parameters.iter().map(|(kind, name)| format!("{} {name}", own(kind))).collect();
    format!(
        "\n{}    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]\n    public delegate {} {}{}({});\n",
        summary(interface, "    ", &field.docs.join(" "), Some(structure)),
        own(result),
        pascal(&structure.name),
        pascal(&field.name),
        parameters.join(", ")
    )
}

fn layout(interface: &Interface, structure: &Structure) -> String {
    let has_array = structure.fields.iter().any(|field| matches!(field.kind, Kind::Floats(_)));
    let mut out = String::from("\n") + &summary(interface, "    ", &structure.docs.join(" "), Some(structure));
    let modifier = if has_array { "unsafe partial" } else { "partial" };
    out += "    [StructLayout(LayoutKind.Sequential)]\n";
    out += &format!("    public {modifier} struct {}\n    {{\n", pascal(&structure.name));
    for field in &structure.fields {
        let mut docs = field.docs.join(" ");
        match &field.kind {
            Kind::Function(..) => docs += &format!(" A {}{}.", pascal(&structure.name), pascal(&field.name)),
            Kind::Pointer(pointer) if pointer != "void *" => docs += &format!(" C: {pointer}."),
            _ => {}
        }
        out += &summary(interface, "        ", &docs, Some(structure));
        let count = if let Kind::Floats(count) = field.kind { format!("[{count}]") } else { String::new() };
        out += &format!("        public {} {}{count};\n", kind(field), pascal(&field.name));
    }
    out + "    }\n"
}
