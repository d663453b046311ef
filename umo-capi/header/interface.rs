//! The C interface as data: constants, their groups, structures and memory layouts.

/// Constants and structures of `umo.h`, in its order.
pub(crate) struct Interface {
    pub(crate) constants: Vec<Constant>,
    pub(crate) structures: Vec<Structure>,
}

pub(crate) struct Constant {
    /// Name without `UMO_`.
    pub(crate) name: String,
    pub(crate) value: i64,
    pub(crate) docs: Vec<String>,
}

pub(crate) struct Structure {
    /// Name without `umo_`.
    pub(crate) name: String,
    pub(crate) docs: Vec<String>,
    pub(crate) fields: Vec<Field>,
}

pub(crate) struct Field {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) docs: Vec<String>,
}

/// Type of a field.
pub(crate) enum Kind {
    U32,
    I32,
    U64,
    F32,
    F64,
    /// Array of `float`.
    Floats(usize),
    /// Pointer, in C.
    Pointer(String),
    /// Pointer to a function: its result in C, and types and names of its parameters.
    Function(String, Vec<(String, String)>),
}

/// Constants of the same prefix, which number the values of one thing.
pub(crate) struct Group {
    pub(crate) prefix: &'static str,
    /// Name of the type.
    pub(crate) name: &'static str,
    /// Name of the table of its values.
    pub(crate) table: &'static str,
    /// Values are bits that can be added.
    pub(crate) is_bits: bool,
    pub(crate) doc: &'static str,
}

const fn group(prefix: &'static str, name: &'static str, table: &'static str, doc: &'static str) -> Group {
    Group { prefix, name, table, is_bits: false, doc }
}

/// Constants of no group here are single.
const GROUPS: [Group; 22] = [
    group("STATUS", "Status", "STATUSES", "Result of a call: OK, or a negative error code."),
    group("AXES", "Axes", "AXES", "Axes, handedness and unit of length."),
    group("ENGINE", "EngineMode", "ENGINE_MODES", "Threads that compute: the engine's own, or the host's."),
    group("PRIORITY", "Priority", "PRIORITIES", "Priority of an engine's own threads."),
    group("CORES", "CoreKinds", "CORE_KINDS", "Kinds of cores that an engine's own threads run on."),
    group("PARTS", "ModelParts", "MODEL_PARTS", "Networks of a model to load."),
    group("SIDE", "Side", "SIDES", "Hand of a gesture."),
    Group { is_bits: true, ..group("GESTURE", "Gesture", "GESTURE_PARTS", "Parts of the body that a gesture moves.") },
    group("LOG", "LogLevel", "LOG_LEVELS", "Level of a log message."),
    group("PRECISION", "Precision", "PRECISIONS", "Precision of a model's weights."),
    group("ISA", "Isa", "ISAS", "Upper bound on the instruction set."),
    group("MODEL", "ModelText", "MODEL_TEXTS", "Text of a model."),
    group("PARAMETER", "Parameter", "PARAMETERS", "Parameter of a running session."),
    group("ATTENTION", "Attention", "ATTENTIONS", "Attention of the avatar."),
    group("MOOD", "Mood", "MOODS", "Mood of face and posture."),
    group("LIPS", "LipShape", "LIPS", "Shape of the lips for a visible sound."),
    group("IDLE", "Idle", "IDLES", "Behaviour while no audio comes."),
    group("VOICE", "Voice", "VOICES", "Timing of the mouth, and whether there is a body."),
    group("PACKETS", "Packets", "PACKETS", "Output of chunks as packets."),
    Group { is_bits: true, ..group("SCENE", "ScenePart", "SCENE_PARTS", "Parts that a scene plays of a member.") },
    group("ROLE", "Role", "ROLES", "What a member of a scene does."),
    group("FORMAT", "FileFormat", "FORMATS", "Format of a file of frames."),
];
/// Constants that have a group's prefix but number none of its values.
const SINGLE: [&str; 2] = ["PARAMETER_WHOLE", "SCENE_MEMBER_COUNT"];

/// Fields that are not for hosts to set: the size, and those that a binding sets from other arguments.
const NOT_SET: [&str; 4] = ["struct_size", "mode", "core_count", "reserved"];

/// Spelling of names in a language.
pub(crate) trait Spelling {
    fn structure(&self, name: &str) -> String;
    fn field(&self, name: &str) -> String;
    fn constant(&self, constant: &Constant) -> String;
    fn group(&self, group: &Group, members: &[&Constant]) -> String;
}

impl Constant {
    pub(crate) fn group(&self) -> Option<&'static Group> {
        let prefix = self.name.split('_').next()?;
        GROUPS.iter().find(|group| group.prefix == prefix && !SINGLE.contains(&self.name.as_str()))
    }

    /// Name within its group.
    pub(crate) fn member(&self) -> &str {
        self.group().map_or(&self.name, |group| &self.name[group.prefix.len() + 1..])
    }

    /// Whether it counts values or bytes.
    pub(crate) fn is_count(&self) -> bool {
        self.name.ends_with("_COUNT") || self.name.ends_with("_SIZE")
    }
}

impl Interface {
    /// Constants without a group.
    pub(crate) fn single(&self) -> impl Iterator<Item = &Constant> {
        self.constants.iter().filter(|constant| constant.group().is_none())
    }

    /// Groups with their constants.
    pub(crate) fn groups(&self) -> impl Iterator<Item = (&'static Group, Vec<&Constant>)> {
        GROUPS.iter().map(|group| {
            let is_member = |constant: &&Constant| constant.group().is_some_and(|own| own.prefix == group.prefix);
            let members: Vec<_> = self.constants.iter().filter(is_member).collect();
            assert!(!members.is_empty(), "no constant begins with UMO_{}_", group.prefix);
            (group, members)
        })
    }

    pub(crate) fn members(&self, group: &Group) -> Vec<&Constant> {
        self.groups().find(|(own, _)| own.prefix == group.prefix).map(|(_, members)| members).unwrap_or_default()
    }

    pub(crate) fn structure(&self, name: &str) -> &Structure {
        self.structures.iter().find(|own| own.name == name).expect("umo.h has the structure")
    }

    /// Lines of a comment, with the names of C in backticks replaced by those of a language.
    pub(crate) fn translated(&self, docs: &[String], spelling: &dyn Spelling, own: Option<&Structure>) -> Vec<String> {
        docs.iter().map(|line| self.translated_line(line, spelling, own)).collect()
    }

    fn translated_line(&self, line: &str, spelling: &dyn Spelling, own: Option<&Structure>) -> String {
        let mut out = String::new();
        for (index, part) in line.split('`').enumerate() {
            if index % 2 == 0 {
                out += part;
                continue;
            }
            let translated = self.translated_name(part, spelling, own);
            out += &format!("`{}`", translated.as_deref().unwrap_or(part));
        }
        out
    }

    fn translated_name(&self, name: &str, spelling: &dyn Spelling, own: Option<&Structure>) -> Option<String> {
        if let Some(name) = name.strip_prefix("UMO_") {
            if let Some(prefix) = name.strip_suffix("_…") {
                let group = GROUPS.iter().find(|group| group.prefix == prefix);
                return group.map(|group| spelling.group(group, &self.members(group)));
            }
            return self.constants.iter().find(|own| own.name == name).map(|own| spelling.constant(own));
        }
        if let Some(name) = name.strip_prefix("umo_") {
            let (name, field) = name.split_once('.').map_or((name, None), |(name, field)| (name, Some(field)));
            let name = spelling.structure(&self.structures.iter().find(|own| own.name == name)?.name);
            return Some(field.map_or(name.clone(), |field| format!("{name}.{}", spelling.field(field))));
        }
        if let Some(name) = name.strip_prefix("sizeof(umo_") {
            return Some(format!("sizeof({})", spelling.structure(name.strip_suffix(')')?)));
        }
        own?.fields.iter().find(|field| field.name == name).map(|field| spelling.field(&field.name))
    }
}

impl Structure {
    /// Numbers that a host sets, or that a call writes for it.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = &Field> {
        self.fields.iter().filter(|field| field.is_number() && !NOT_SET.contains(&field.name.as_str()))
    }

    /// Bytes, and the offset of each field, where a pointer has `pointer` bytes and 64-bit numbers are aligned to 8.
    pub(crate) fn layout(&self, pointer: usize) -> (usize, Vec<usize>) {
        let (mut end, mut alignment, mut offsets) = (0_usize, 1, Vec::new());
        for field in &self.fields {
            let (size, aligned) = match field.kind {
                Kind::U32 | Kind::I32 | Kind::F32 => (4, 4),
                Kind::U64 | Kind::F64 => (8, 8),
                Kind::Floats(count) => (4 * count, 4),
                Kind::Pointer(_) | Kind::Function(..) => (pointer, pointer),
            };
            let offset = end.next_multiple_of(aligned);
            offsets.push(offset);
            (end, alignment) = (offset + size, alignment.max(aligned));
        }
        (end.next_multiple_of(alignment), offsets)
    }
}

impl Field {
    fn is_number(&self) -> bool {
        matches!(self.kind, Kind::U32 | Kind::I32 | Kind::U64 | Kind::F32 | Kind::F64)
    }

    /// Group of its values: the one that its comment names as `UMO_…_…`.
    pub(crate) fn group(&self) -> Option<&'static Group> {
        let docs = self.docs.join(" ");
        let (_, after) = docs.split_once("`UMO_").filter(|(_, after)| after.contains("_…`"))?;
        let (prefix, _) = after.split_once("_…`")?;
        let group = GROUPS.iter().find(|group| group.prefix == prefix);
        group.filter(|_| matches!(self.kind, Kind::U32 | Kind::Function(..)))
    }
}

/// `engine_config` as `EngineConfig`, `GAIN_FACE` as `GainFace`.
pub(crate) fn pascal(name: &str) -> String {
    name.split('_').map(|word| word[..1].to_ascii_uppercase() + &word[1..].to_ascii_lowercase()).collect()
}

/// `engine_config` as `engineConfig`.
pub(crate) fn camel(name: &str) -> String {
    let name = pascal(name);
    name[..1].to_ascii_lowercase() + &name[1..]
}

/// Text in lines of at most `width` characters.
pub(crate) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut().expect("there is one line at least");
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(word.to_owned());
            continue;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    lines
}
