//! Layout of frames in the host's memory, in its engine's axes.

use std::ffi::c_void;

#[cfg(feature = "gltf")]
use umo_core::Pose;
use umo_core::{Frame, JOINTS, VISEMES};
use umo_core_pose::axes::Axes;

use crate::ffi::{self, Sized32, guard};
use crate::model::{self, ModelHandle, UmoModel};
use crate::status::{Failure, UMO_STATUS_BUFFER_TOO_SMALL, UMO_STATUS_UNSUPPORTED, UmoStatus};

/// Offset meaning: do not write this field.
pub const UMO_ABSENT: u32 = 0xffff_ffff;

/// Layout of a frame in the host's memory: offsets in bytes from the frame's start. A value whose offset
/// is `UMO_ABSENT` is not written, and bytes between values are left alone, so that frames can be the
/// host's own structures. Initialise it with `umo_frame_layout_init`.
///
/// Offsets and strides are multiples of the values' alignment in C: 4, and for `index` and `sample` that
/// of `uint64_t`, which then also applies to `frame_stride`. Values must not overlap, not even in one
/// byte, but values of different kinds may be interleaved. A layout that breaks this is
/// `INVALID_ARGUMENT`, and `umo_last_error` names the fields.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UmoFrameLayout {
    /// `sizeof(umo_frame_layout)`.
    pub struct_size: u32,
    /// One of `UMO_AXES_…`.
    pub axes: u32,
    /// Bytes from one frame to the next, at least up to the end of the last value.
    pub frame_stride: u32,
    /// `uint64_t`: number of the frame since the start or the last reset; there are
    /// `umo_model_info.frame_rate` frames per second.
    pub index: u32,
    /// `uint64_t`: sample of the pushed audio, counted per channel, that the frame belongs to.
    pub sample: u32,
    /// `float[3]`: translation of the root, to be added to the first joint's offset in
    /// `umo_model_get_skeleton`. The floor is at 0 as in the model.
    pub translation: u32,
    /// `float[4]` of the first joint: its rotation in its parent's frame, a unit quaternion x, y, z, w.
    pub rotations: u32,
    /// Bytes from one joint's rotation to the next, at least 16.
    pub rotation_stride: u32,
    /// `float` of the first face channel.
    pub channels: u32,
    /// Bytes from one channel to the next, at least 4.
    pub channel_stride: u32,
    /// `float[UMO_VISEME_COUNT]`: weights of the visemes; they sum to 1.
    pub visemes: u32,
    /// Zero, as `umo_frame_layout_init` sets it: anything else is `INVALID_ARGUMENT`.
    pub reserved: u32,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoFrameLayout {
    const FIRST: usize = 48;
}

/// Largest stride or offset, in bytes.
const MAX_OFFSET: u32 = 1 << 24;

/// A layout checked against a model.
#[derive(Clone, Copy)]
pub(crate) struct Layout<'a> {
    given: UmoFrameLayout,
    axes: Axes,
    model: &'a ModelHandle,
    /// End of a frame's last value, in bytes.
    extent: usize,
}

/// A run of equally spaced values, with the size and alignment of each.
struct Run {
    name: &'static str,
    offset: u32,
    stride: u32,
    count: usize,
    size: u32,
    align: usize,
}

impl Run {
    /// Whether the run has values and is written.
    const fn is_written(&self) -> bool {
        self.offset != UMO_ABSENT && self.count > 0
    }

    /// Start of value number `index`, in bytes.
    const fn start(&self, index: usize) -> usize {
        self.offset as usize + index * self.stride as usize
    }

    /// End of the last value, in bytes.
    const fn end(&self) -> usize {
        self.start(self.count - 1) + self.size as usize
    }

    /// Checks the run's offset and stride.
    fn check(&self) -> Result<(), Failure> {
        let Self { name, offset, stride, size, align, .. } = *self;
        if offset > MAX_OFFSET || stride > MAX_OFFSET {
            return Err(Failure::argument(format_args!(
                "layout: {name} at byte {offset} with a stride of {stride}: both must be at most {MAX_OFFSET}"
            )));
        }
        if stride < size {
            return Err(Failure::argument(format_args!(
                "layout: {name} has a stride of {stride}: it must be at least {size}, the size of one value"
            )));
        }
        if !(offset as usize).is_multiple_of(align) || !(stride as usize).is_multiple_of(align) {
            return Err(Failure::argument(format_args!(
                "layout: {name} at byte {offset} with a stride of {stride}: both must be a multiple of {align}"
            )));
        }
        Ok(())
    }

    /// Returns the first byte that two runs share. Both are sorted and do not overlap themselves, so one pass
    /// along both suffices.
    fn overlap(&self, other: &Self) -> Option<usize> {
        if self.end() <= other.start(0) || other.end() <= self.start(0) {
            return None;
        }
        let (mut i, mut j) = (0, 0);
        while i < self.count && j < other.count {
            let (a, b) = (self.start(i), other.start(j));
            if a + self.size as usize <= b {
                i += 1;
            } else if b + other.size as usize <= a {
                j += 1;
            } else {
                return Some(a.max(b));
            }
        }
        None
    }
}

/// Alignment of a `float` and of a `uint64_t` in the host's structures, in bytes.
const FLOAT_ALIGN: usize = align_of::<f32>();
const COUNT_ALIGN: usize = align_of::<u64>();

impl UmoFrameLayout {
    fn runs(&self, channels: usize) -> [Run; 6] {
        let counter = |name, offset| Run { name, offset, stride: 8, count: 1, size: 8, align: COUNT_ALIGN };
        let floats = |name, offset, stride, count, size| Run { name, offset, stride, count, size, align: FLOAT_ALIGN };
        [
            counter("index", self.index),
            counter("sample", self.sample),
            floats("translation", self.translation, 12, 1, 12),
            floats("rotations", self.rotations, self.rotation_stride, JOINTS, 16),
            floats("channels", self.channels, self.channel_stride, channels, 4),
            floats("visemes", self.visemes, 4, VISEMES, 4),
        ]
    }

    /// Layout without gaps: index, sample, translation, rotations, channels, and visemes if the model has
    /// them.
    #[expect(clippy::cast_possible_truncation, reason = "a frame has a few thousand bytes")]
    fn packed(model: &ModelHandle) -> Self {
        let rotations = 8 + 8 + 12;
        let channels = rotations + 16 * JOINTS;
        let visemes = channels + 4 * model.model.config().face.names.len();
        let (visemes, end) = match model.visemes {
            Some(_) => (visemes as u32, visemes + 4 * VISEMES),
            None => (UMO_ABSENT, visemes),
        };
        Self {
            struct_size: 0,
            axes: crate::UMO_AXES_GLTF,
            frame_stride: end.next_multiple_of(8) as u32,
            index: 0,
            sample: 8,
            translation: 16,
            rotations: rotations as u32,
            rotation_stride: 16,
            channels: channels as u32,
            channel_stride: 4,
            visemes,
            reserved: 0,
        }
    }

    /// Checks everything except the axes, for a face of `channels` channels; returns the end of the last
    /// value in bytes.
    fn check(&self, channels: usize, has_visemes: bool) -> Result<usize, Failure> {
        if self.reserved != 0 {
            let what = format_args!(
                "layout: `reserved` is {}: it must be 0; start the layout with umo_frame_layout_init",
                self.reserved
            );
            return Err(Failure::argument(what));
        }
        let (mut extent, mut align) = (0, 1);
        let runs = self.runs(channels);
        let written = || runs.iter().filter(|run| run.is_written());
        for run in written() {
            run.check()?;
            extent = extent.max(run.end());
            align = align.max(run.align);
        }
        for (i, run) in written().enumerate() {
            for other in written().skip(i + 1) {
                let Some(byte) = run.overlap(other) else { continue };
                let what = format_args!(
                    "layout: {} and {} overlap at byte {byte}: move one, or set an offset that is not wanted to UMO_ABSENT",
                    run.name, other.name
                );
                return Err(Failure::argument(what));
            }
        }
        if self.visemes != UMO_ABSENT && !has_visemes {
            let what = "layout: visemes are wanted, but this model's face has no ARKit channels";
            return Err(Failure::new(UMO_STATUS_UNSUPPORTED, what));
        }
        if self.frame_stride > MAX_OFFSET || extent > self.frame_stride as usize {
            let what = format_args!(
                "layout: a frame has {extent} bytes: frame_stride is {}, and must be at least that and at most {MAX_OFFSET}",
                self.frame_stride
            );
            return Err(Failure::argument(what));
        }
        if !(self.frame_stride as usize).is_multiple_of(align) {
            let what = format_args!(
                "layout: frame_stride is {}: it must be a multiple of {align}, so that every frame's values are aligned",
                self.frame_stride
            );
            return Err(Failure::argument(what));
        }
        Ok(extent)
    }
}

impl<'a> Layout<'a> {
    /// Checks a layout: no value may be written outside its frame, over another value, or unaligned.
    pub(crate) fn new(given: UmoFrameLayout, model: &'a ModelHandle) -> Result<Self, Failure> {
        let axes = crate::axes(given.axes)?;
        let extent = given.check(model.model.config().face.names.len(), model.visemes.is_some())?;
        Ok(Self { given, axes, model, extent })
    }

    /// Number of frames that fit in `size` bytes.
    pub(crate) fn room(&self, size: usize) -> usize {
        match self.given.frame_stride as usize {
            // A layout without values: nothing is written, so any number of frames fits.
            0 => usize::MAX,
            stride => size.checked_sub(self.extent).map_or(0, |rest| rest / stride + 1),
        }
    }

    /// Checks that at least one frame fits.
    pub(crate) fn check_room(&self, size: usize) -> Result<(), Failure> {
        if self.room(size) > 0 {
            return Ok(());
        }
        let what = format_args!("there are {size} bytes, a frame has {}", self.extent);
        Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what))
    }

    /// Writes frame number `number` to `bytes`.
    ///
    /// # Safety
    /// `bytes` has as many writable bytes as were passed to [`Self::room`], `number` is less than its
    /// result, and no other thread accesses them.
    pub(crate) unsafe fn write(&self, bytes: *mut u8, number: usize, frame: Frame) {
        let given = &self.given;
        let stride = given.frame_stride as usize;
        // SAFETY: frames up to `number` lie within the bytes.
        let start = unsafe { bytes.add(number * stride) };
        let put = |offset: u32, index: usize, stride: u32, value: &[u8]| {
            if offset == UMO_ABSENT {
                return;
            }
            // SAFETY: `new` has checked that every value lies within the frame, and the caller guarantees that
            // the frame lies within the bytes.
            let place = unsafe { start.add(offset as usize + index * stride as usize) };
            // SAFETY: as above; bytes need no alignment, and the value is this library's own.
            unsafe { place.copy_from_nonoverlapping(value.as_ptr(), value.len()) };
        };
        put(given.index, 0, 0, &frame.index.to_ne_bytes());
        put(given.sample, 0, 0, &frame.sample.to_ne_bytes());
        let translation = self.axes.place(frame.pose.translation).map(f32::to_ne_bytes);
        put(given.translation, 0, 0, translation.as_flattened());
        for (joint, &rotation) in frame.pose.rotations.iter().enumerate() {
            let rotation = self.axes.rotation(rotation).map(f32::to_ne_bytes);
            put(given.rotations, joint, given.rotation_stride, rotation.as_flattened());
        }
        for (channel, value) in frame.face.iter().enumerate() {
            put(given.channels, channel, given.channel_stride, &value.to_ne_bytes());
        }
        if let (Some(visemes), true) = (&self.model.visemes, given.visemes != UMO_ABSENT) {
            let weights = visemes.weights(frame.face).map(f32::to_ne_bytes);
            put(given.visemes, 0, 0, weights.as_flattened());
        }
    }
}

/// Frames of the host's, to be read.
#[cfg(feature = "gltf")]
pub(crate) struct Given<'a> {
    layout: UmoFrameLayout,
    axes: Axes,
    channels: usize,
    bytes: &'a [u8],
}

#[cfg(feature = "gltf")]
impl<'a> Given<'a> {
    /// Reads `count` frames, at least one, with a face of `channels` channels.
    ///
    /// # Safety
    /// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or has `count` readable
    /// frames of that layout.
    pub(crate) unsafe fn read(
        layout: *const UmoFrameLayout,
        frames: *const c_void,
        count: usize,
        channels: usize,
    ) -> Result<Self, Failure> {
        // SAFETY: guaranteed by the caller (see # Safety).
        let layout = unsafe { ffi::read(layout, "clip.layout")? };
        let axes = crate::axes(layout.axes)?;
        let extent = layout.check(channels, true)?;
        let wanted = [
            ("translation", layout.translation, 1),
            ("rotations", layout.rotations, 1),
            ("channels", layout.channels, channels),
        ];
        if let Some((name, ..)) = wanted.iter().find(|&&(_, offset, values)| offset == UMO_ABSENT && values > 0) {
            return Err(Failure::argument(format_args!("layout: {name} is UMO_ABSENT, but a file needs it")));
        }
        let last = (count - 1).checked_mul(layout.frame_stride as usize).and_then(|start| start.checked_add(extent));
        let size =
            last.ok_or_else(|| Failure::argument(format_args!("`clip`: {count} frames are more than memory holds")))?;
        // SAFETY: guaranteed by the caller (see # Safety): the last frame ends there.
        let bytes = unsafe { ffi::slice(frames.cast::<u8>(), size, "clip.frames")? };
        Ok(Self { layout, axes, channels, bytes })
    }

    /// Returns the pose of frame `number` in umo's own axes, and appends its face values to `face`.
    pub(crate) fn frame(&self, number: usize, face: &mut Vec<f32>) -> Pose {
        let start = number * self.layout.frame_stride as usize;
        let float = |offset: usize| {
            let bytes = &self.bytes[start + offset..][..size_of::<f32>()];
            f32::from_ne_bytes(bytes.try_into().expect("of that length"))
        };
        let Self { layout, axes, .. } = self;
        let (translation, rotations) = (layout.translation as usize, layout.rotations as usize);
        let channel = |index: usize| float(layout.channels as usize + index * layout.channel_stride as usize);
        face.extend((0..self.channels).map(channel));
        let rotation = |joint: usize| rotations + joint * layout.rotation_stride as usize;
        Pose {
            translation: axes.place_from(std::array::from_fn(|axis| float(translation + 4 * axis))),
            rotations: std::array::from_fn(|joint| {
                axes.rotation_from(std::array::from_fn(|i| float(rotation(joint) + 4 * i)))
            }),
        }
    }
}

/// Reads and checks a layout.
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says.
pub(crate) unsafe fn read<'a>(layout: *const UmoFrameLayout, model: &'a ModelHandle) -> Result<Layout<'a>, Failure> {
    // SAFETY: guaranteed by the caller (see # Safety).
    Layout::new(unsafe { ffi::read(layout, "layout")? }, model)
}

/// Fills a layout for frames without gaps, in glTF's axes: index, sample, translation, rotations,
/// channels, and visemes if the model has ARKit channels. `size` is `sizeof *layout`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
///
/// # Safety
/// `layout` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_frame_layout_init(
    layout: *mut UmoFrameLayout,
    size: usize,
    model: *const UmoModel,
) -> UmoStatus {
    guard(|| {
        let packed = UmoFrameLayout::packed(&*model::get(model)?);
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::initialise(layout, size, "layout", &packed) }
    })
}

/// Checks a layout against a model, and computes the number of frames that fit in `size` bytes.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT`, `UNSUPPORTED`
/// (`umo_last_error` has the reason).
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_frame_layout_check(
    layout: *const UmoFrameLayout,
    model: *const UmoModel,
    size: usize,
    frames: *mut usize,
) -> UmoStatus {
    guard(|| {
        let model = model::get(model)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let room = unsafe { read(layout, &model)? }.room(size);
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::put_if_wanted(frames, "frames", room) }
    })
}

/// Checks the host's memory for one frame.
pub(crate) fn one(frame: *mut c_void) -> Result<*mut u8, Failure> {
    if frame.is_null() { Err(Failure::null("frame")) } else { Ok(frame.cast()) }
}
