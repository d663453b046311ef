//! Layouts of the structures, for a C compiler to check: the offsets of JavaScript are computed in the same way.

use super::NOTICE;
use super::interface::Interface;

/// `SIZE(structure, bytes where pointers have 64 bits, bytes where they have 32)`, and `FIELD` with its offsets.
pub(crate) fn layouts(interface: &Interface) -> String {
    let mut out = format!("/* {NOTICE} */\n");
    for structure in &interface.structures {
        let ((size, wide), (narrow_size, narrow)) = (structure.layout(8), structure.layout(4));
        out += &format!("SIZE(umo_{}, {size}, {narrow_size});\n", structure.name);
        for ((field, wide), narrow) in structure.fields.iter().zip(wide).zip(narrow) {
            out += &format!("FIELD(umo_{}, {}, {wide}, {narrow});\n", structure.name, field.name);
        }
    }
    out
}
