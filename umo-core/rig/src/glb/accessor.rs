//! Numeric data in the buffer of a `.glb`.

use serde::Deserialize;
use umo_core_base::memory::with_capacity;

use super::document::{Document, View};

/// Upper bound on the numbers of one accessor: an hour of 64 morph weights at 60 frames a second.
const MAX_NUMBERS: usize = 3600 * 60 * 64;

/// Reads an accessor as floats, component by component. Integers must be normalized.
///
/// # Errors
/// The accessor is missing, too large or not supported, or has a number that is not finite.
pub fn floats(document: &Document, bin: &[u8], index: usize, kind: &str) -> Result<Vec<f32>, String> {
    let wrong = |problem: String| format!("accessor {index}: {problem}");
    let accessor = document.accessors.get(index).ok_or_else(|| wrong("does not exist".to_owned()))?;
    if accessor.kind != kind {
        return Err(wrong(format!("expected {kind}, got {}", accessor.kind)));
    }
    if accessor.sparse.is_some() {
        return Err(wrong("it is sparse".to_owned()));
    }
    let width = width(kind).ok_or_else(|| wrong(format!("type {kind}")))?;
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

/// Reads an accessor as floats and returns them with the number of components per value. Integers are converted as
/// they are, or to fractions if they are normalized. `kinds` lists the accepted types.
///
/// # Errors
/// As [`floats`], except that sparse accessors are accepted.
pub fn numbers(document: &Document, bin: &[u8], index: usize, kinds: &[&str]) -> Result<(Vec<f32>, usize), String> {
    let wrong = |problem: String| format!("accessor {index}: {problem}");
    let accessor = document.accessors.get(index).ok_or_else(|| wrong("does not exist".to_owned()))?;
    if !kinds.contains(&accessor.kind.as_str()) {
        return Err(wrong(format!("expected {}, got {}", kinds.join(" or "), accessor.kind)));
    }
    let width = width(&accessor.kind).ok_or_else(|| wrong(format!("type {}", accessor.kind)))?;
    let (size, read) = component(accessor.component_type, accessor.normalized)
        .or_else(|| whole(accessor.component_type))
        .ok_or_else(|| wrong(format!("component type {}", accessor.component_type)))?;
    let total = accessor.count.checked_mul(width).filter(|&numbers| numbers <= MAX_NUMBERS);
    let total = total.ok_or_else(|| wrong(format!("{} values are too many", accessor.count)))?;
    let rows = |view: usize, offset: usize, count: usize, size: usize, width: usize| {
        let view = document.buffer_views.get(view).ok_or("it has no data")?;
        let bytes = bytes(document, bin, view)?;
        let row = size * width;
        let stride = view.byte_stride.unwrap_or(row);
        let at = move |at: usize| {
            let start = at.checked_mul(stride)?.checked_add(offset)?;
            bytes.get(start..start.checked_add(row)?)
        };
        (0..count).map(at).collect::<Option<Vec<_>>>().ok_or_else(|| "it reaches beyond its data".to_owned())
    };
    let mut values = with_capacity(total);
    match accessor.buffer_view {
        Some(view) => {
            let rows = rows(view, accessor.byte_offset, accessor.count, size, width).map_err(wrong)?;
            values.extend(rows.into_iter().flat_map(|row| row.chunks_exact(size).map(read)));
        }
        None => values.resize(total, 0.0),
    }
    if let Some(sparse) = &accessor.sparse {
        let sparse = Sparse::deserialize(sparse).map_err(|error| wrong(error.to_string()))?;
        let Sparse { count, indices, values: others } = sparse;
        let kind = indices.component_type.and_then(whole);
        let (bytes, index) = kind.ok_or_else(|| wrong("a sparse index of another type".to_owned()))?;
        if count > accessor.count {
            return Err(wrong("it is more than its values".to_owned()));
        }
        let places = rows(indices.buffer_view, indices.byte_offset, count, bytes, 1).map_err(wrong)?;
        let rows = rows(others.buffer_view, others.byte_offset, count, size, width).map_err(wrong)?;
        for (place, row) in places.into_iter().zip(rows) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number of one list")]
            let start = index(place) as usize * width;
            let values = values.get_mut(start..start + width).ok_or_else(|| wrong("a sparse index".to_owned()))?;
            values.iter_mut().zip(row.chunks_exact(size).map(read)).for_each(|(value, new)| *value = new);
        }
    }
    match values.iter().all(|value| value.is_finite()) {
        true => Ok((values, width)),
        false => Err(wrong("it holds a value that is not a finite number".to_owned())),
    }
}

/// Replacement values for a sparse accessor, and their indices.
#[derive(Deserialize)]
struct Sparse {
    count: usize,
    indices: Part,
    values: Part,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Part {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
    component_type: Option<u32>,
}

/// Returns the bytes of a view by its index.
///
/// # Errors
/// The view does not exist or is not in the file.
pub fn view_bytes<'a>(document: &Document, bin: &'a [u8], view: usize) -> Result<&'a [u8], String> {
    let found = document.buffer_views.get(view).ok_or_else(|| format!("there is no view {view}"))?;
    bytes(document, bin, found)
}

/// Number of components of a type.
fn width(kind: &str) -> Option<usize> {
    let widths = [("SCALAR", 1), ("VEC2", 2), ("VEC3", 3), ("VEC4", 4), ("MAT4", 16)];
    widths.iter().find(|(known, _)| *known == kind).map(|(_, width)| *width)
}

/// Returns the bytes of a view.
fn bytes<'a>(document: &Document, bin: &'a [u8], view: &View) -> Result<&'a [u8], String> {
    let first = document.buffers.first().filter(|buffer| view.buffer == 0 && buffer.uri.is_none());
    let first = first.ok_or("its data is not in this file")?;
    let bin = bin.get(..first.byte_length).ok_or("the file is cut short")?;
    let end = view.byte_offset.checked_add(view.byte_length);
    end.and_then(|end| bin.get(view.byte_offset..end)).ok_or_else(|| "its view reaches beyond the buffer".to_owned())
}

/// Size of a component in bytes, and its decoder.
type Component = (usize, fn(&[u8]) -> f32);

/// Decoder of unsigned integers; exact up to 2^24.
fn whole(kind: u32) -> Option<Component> {
    #[expect(clippy::cast_precision_loss, reason = "lists are shorter than the numbers that f32 tells apart")]
    match kind {
        5121 => Some((1, |b| f32::from(b[0]))),
        5123 => Some((2, |b| f32::from(u16::from_le_bytes([b[0], b[1]])))),
        5125 => Some((4, |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32)),
        _ => None,
    }
}

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
