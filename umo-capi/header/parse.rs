//! Reads `umo.h` as cbindgen writes it. What it does not understand is a panic.

use super::interface::{Constant, Field, Interface, Kind, Structure};

/// Constants and structures of a header.
pub(crate) fn parse(header: &str) -> Interface {
    let mut interface = Interface { constants: Vec::new(), structures: Vec::new() };
    let (mut docs, mut lines) = (Vec::new(), header.lines());
    while let Some(line) = lines.next() {
        if let Some(doc) = line.strip_prefix("//") {
            docs.push(doc.trim().to_owned());
        } else if let Some(define) = line.strip_prefix("#define UMO_") {
            interface.constants.extend(constant(define, std::mem::take(&mut docs)));
        } else if let Some(name) = line.strip_prefix("typedef struct umo_").and_then(|line| line.strip_suffix(" {")) {
            let fields = fields(&mut lines, name);
            interface.structures.push(Structure { name: name.to_owned(), docs: std::mem::take(&mut docs), fields });
        } else {
            docs.clear();
        }
    }
    interface
}

/// A constant; none for macros that are not numbers.
fn constant(define: &str, docs: Vec<String>) -> Option<Constant> {
    let (name, value) = define.split_once(' ')?;
    let value = value.parse().ok()?;
    assert!(!docs.is_empty(), "UMO_{name} has no comment");
    Some(Constant { name: name.to_owned(), value, docs })
}

fn fields<'a>(lines: &mut impl Iterator<Item = &'a str>, name: &str) -> Vec<Field> {
    let (mut docs, mut fields, mut declaration) = (Vec::new(), Vec::new(), String::new());
    for line in lines {
        if line.starts_with('}') {
            assert_eq!(line, format!("}} umo_{name};"));
            return fields;
        }
        let line = line.trim();
        if let Some(doc) = line.strip_prefix("//") {
            docs.push(doc.trim().to_owned());
            continue;
        }
        declaration += line;
        if let Some(whole) = declaration.strip_suffix(';') {
            assert!(!docs.is_empty(), "umo_{name}: {whole} has no comment");
            fields.push(field(whole, std::mem::take(&mut docs)));
            declaration.clear();
        } else {
            declaration.push(' ');
        }
    }
    panic!("umo_{name} does not end");
}

fn field(declaration: &str, docs: Vec<String>) -> Field {
    if let Some((result, rest)) = declaration.split_once("(*") {
        let (name, rest) = rest.split_once(")(").expect("a pointer to a function");
        let parameters = rest.strip_suffix(')').expect("a pointer to a function");
        let kind = Kind::Function(result.trim().to_owned(), split(parameters));
        return Field { name: name.to_owned(), kind, docs };
    }
    let (kind, name) = declared(declaration);
    let (name, count) = match name.split_once('[') {
        Some((name, count)) => (name, count.strip_suffix(']').and_then(|count| count.parse().ok())),
        None => (name, None),
    };
    let kind = match (kind, count) {
        ("uint32_t", None) => Kind::U32,
        ("int32_t", None) => Kind::I32,
        ("uint64_t", None) => Kind::U64,
        ("float", None) => Kind::F32,
        ("double", None) => Kind::F64,
        ("float", Some(count)) => Kind::Floats(count),
        (pointer, None) if pointer.ends_with('*') => Kind::Pointer(pointer.to_owned()),
        _ => panic!("`{declaration}` has a type that the generators do not know"),
    };
    Field { name: name.to_owned(), kind, docs }
}

/// Type and name of a declaration.
fn declared(text: &str) -> (&str, &str) {
    let at = text.rfind([' ', '*']).expect("a type and a name") + 1;
    (text[..at].trim(), &text[at..])
}

/// Parameters of a function, each with its type; that of a pointer to a function is `(*)`.
fn split(parameters: &str) -> Vec<(String, String)> {
    let (mut depth, mut parts) = (0, vec![String::new()]);
    for letter in parameters.chars() {
        match letter {
            '(' => depth += 1,
            ')' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(String::new());
                continue;
            }
            _ => {}
        }
        parts.last_mut().expect("there is one part at least").push(letter);
    }
    let parameter = |part: &String| match part.split_once("(*") {
        Some((_, rest)) => ("(*)".to_owned(), rest.split(')').next().unwrap_or_default().to_owned()),
        None => {
            let (kind, name) = declared(part.trim());
            (kind.to_owned(), name.to_owned())
        }
    };
    parts.iter().map(parameter).collect()
}
