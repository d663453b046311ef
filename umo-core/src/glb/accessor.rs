//! Numbers out of the buffer of a `.glb`.

use super::document::{Document, View};
use crate::memory::with_capacity;

/// Most numbers of one list: an hour of 64 morph weights at 60 frames a second.
const MAX_NUMBERS: usize = 3600 * 60 * 64;

/// An accessor's numbers as floats, those of its type in turn; whole numbers only where they stand
/// for fractions.
///
/// # Errors
/// What of it is not there, too large, not understood, or no finite number.
pub fn floats(document: &Document, bin: &[u8], index: usize, kind: &str) -> Result<Vec<f32>, String> {
    let wrong = |problem: String| format!("accessor {index}: {problem}");
    let accessor = document.accessors.get(index).ok_or_else(|| wrong("there is none".to_owned()))?;
    if accessor.kind != kind {
        return Err(wrong(format!("expected {kind}, got {}", accessor.kind)));
    }
    if accessor.sparse.is_some() {
        return Err(wrong("it is sparse".to_owned()));
    }
    let width = match kind {
        "SCALAR" => 1,
        "VEC3" => 3,
        "VEC4" => 4,
        "MAT4" => 16,
        _ => return Err(wrong(format!("type {kind}"))),
    };
    let (size, read) = component(accessor.component_type, accessor.normalized)
        .ok_or_else(|| wrong(format!("component type {}", accessor.component_type)))?;
    if accessor.count.checked_mul(width).is_none_or(|numbers| numbers > MAX_NUMBERS) {
        return Err(wrong(format!("{} values are too many", accessor.count)));
    }
    let view = accessor.buffer_view.and_then(|view| document.buffer_views.get(view));
    let view = view.ok_or_else(|| wrong("it has no data".to_owned()))?;
    let bytes = bytes(document, bin, view).map_err(wrong)?;
    let row = size * width;
    let stride = view.byte_stride.unwrap_or(row);
    let mut values = with_capacity(accessor.count * width);
    for at in 0..accessor.count {
        let start = at.checked_mul(stride).and_then(|start| start.checked_add(accessor.byte_offset));
        let end = start.and_then(|start| start.checked_add(row));
        let row = start.zip(end).and_then(|(start, end)| bytes.get(start..end));
        let row = row.ok_or_else(|| wrong("it reaches beyond its data".to_owned()))?;
        values.extend(row.chunks_exact(size).map(read));
    }
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(values),
        false => Err(wrong("it holds a value that is not a finite number".to_owned())),
    }
}

/// A view's bytes.
fn bytes<'a>(document: &Document, bin: &'a [u8], view: &View) -> Result<&'a [u8], String> {
    let first = document.buffers.first().filter(|buffer| view.buffer == 0 && buffer.uri.is_none());
    let first = first.ok_or("its data is not in this file")?;
    let bin = bin.get(..first.byte_length).ok_or("the file is cut short")?;
    let end = view.byte_offset.checked_add(view.byte_length);
    end.and_then(|end| bin.get(view.byte_offset..end)).ok_or_else(|| "its view reaches beyond the buffer".to_owned())
}

/// Bytes of a number, and what they mean.
type Component = (usize, fn(&[u8]) -> f32);

fn component(kind: u32, normalized: bool) -> Option<Component> {
    match (kind, normalized) {
        (5126, _) => Some((4, |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))),
        (5120, true) => Some((1, |b| (f32::from(i8::from_le_bytes([b[0]])) / 127.0).max(-1.0))),
        (5121, true) => Some((1, |b| f32::from(b[0]) / 255.0)),
        (5122, true) => Some((2, |b| (f32::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0).max(-1.0))),
        (5123, true) => Some((2, |b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0)),
        _ => None,
    }
}
