//! Unreal: the settings of engines as properties, which its header tool reads without the preprocessor.

use super::NOTICE;
use super::interface::{Constant, Field, Group, Interface, Kind, Spelling, pascal, wrapped};

struct Unreal;

impl Spelling for Unreal {
    fn structure(&self, name: &str) -> String {
        format!("umo_{name}")
    }

    fn field(&self, name: &str) -> String {
        pascal(name)
    }

    fn constant(&self, constant: &Constant) -> String {
        match constant.group() {
            None => format!("UMO_{}", constant.name),
            Some(_) => pascal(constant.member()),
        }
    }

    fn group(&self, group: &Group, _: &[&Constant]) -> String {
        format!("EUmo{}", group.name)
    }
}

/// `UmoEngineSettings.h`.
pub(crate) fn settings(interface: &Interface) -> String {
    let structure = interface.structure("engine_config");
    let mut out = format!(
        "// SPDX-License-Identifier: MIT OR Apache-2.0\n// {NOTICE}\n\n#pragma once\n\n#include \"CoreMinimal.h\"\n\
         #include \"Subsystems/EngineSubsystem.h\"\n\n#include \"UmoEngineSettings.generated.h\"\n"
    );
    for group in structure.numbers().filter_map(Field::group) {
        out += &enumeration(interface, group);
    }
    out += "
/** Settings of engines, read when a model is opened. 0 is the library's default. */
UCLASS(Abstract, Config = Game)
class UMO_API UUmoEngineSettings : public UEngineSubsystem
{
	GENERATED_BODY()

public:
";
    let mut set = String::new();
    for field in structure.numbers() {
        assert!(matches!(field.kind, Kind::U32), "{}: settings of engines are whole numbers so far", field.name);
        let name = pascal(&field.name);
        let (kind, zero) = field.group().map_or(("int32".to_owned(), "0".to_owned()), |group| {
            let members = interface.members(group);
            let zero = members.iter().find(|constant| constant.value == 0).expect("a default");
            (format!("EUmo{}", group.name), format!("EUmo{}::{}", group.name, pascal(zero.member())))
        });
        out += &comment(interface, "\t", &field.docs);
        out += &format!("\tUPROPERTY(Config)\n\t{kind} {name} = {zero};\n\n");
        set += &format!("\t\tif ({name} > {zero}) Config.{} = static_cast<uint32>({name});\n", field.name);
    }
    out + "\t/** Sets fields of a `umo_engine_config`. */\n\ttemplate <typename T>\n\tvoid Configure(T& Config) const\n\t{\n"
        + &set
        + "\t}\n};\n"
}

fn enumeration(interface: &Interface, group: &Group) -> String {
    let mut out = format!("\n/** {} */\nUENUM()\nenum class EUmo{} : uint8\n{{\n", group.doc, group.name);
    for constant in interface.members(group) {
        out += &comment(interface, "\t", &constant.docs);
        out += &format!("\t{} = {},\n", pascal(constant.member()), constant.value);
    }
    out + "};\n"
}

fn comment(interface: &Interface, indent: &str, docs: &[String]) -> String {
    let docs = interface.translated(&[docs.join(" ")], &Unreal, None).concat();
    match &wrapped(&docs, 120)[..] {
        [line] => format!("{indent}/** {line} */\n"),
        lines => {
            let lines: String = lines.iter().map(|line| format!("{indent} * {line}\n")).collect();
            format!("{indent}/**\n{lines}{indent} */\n")
        }
    }
}
