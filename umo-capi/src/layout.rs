//! Test of the layout of every structure of the interface.

use std::mem::offset_of;

use crate::clip::{UmoClip, UmoOutput};
use crate::engine::{UmoEngineConfig, UmoJobs};
use crate::ffi::Sized32;
use crate::frame::UmoFrameLayout;
use crate::gesture::{UmoGestureClip, UmoGestureOptions};
use crate::log::UmoLog;
use crate::memory::UmoAllocator;
use crate::model::{UmoModelConfig, UmoModelInfo};
use crate::parameter::UmoParameterInfo;
use crate::retarget::UmoRig;
use crate::session::packets::UmoReceived;
use crate::session::takes::UmoTakeInfo;
use crate::session::{UmoLatency, UmoSampled, UmoSessionConfig, UmoStats};

/// Programs are compiled with these numbers; `tests/capi/generated.h` has all.
#[test]
fn structures_have_the_layout_that_c_has() {
    fn sized<T: Sized32>(bytes: usize) {
        assert_eq!((size_of::<T>(), T::FIRST), (bytes, bytes));
    }
    sized::<UmoModelConfig>(24);
    sized::<UmoFrameLayout>(48);
    sized::<UmoParameterInfo>(40);
    sized::<UmoEngineConfig>(64);
    sized::<UmoSessionConfig>(96);
    sized::<UmoModelInfo>(72);
    sized::<UmoLatency>(72);
    sized::<UmoStats>(64);
    sized::<UmoSampled>(24);
    sized::<UmoReceived>(40);
    sized::<UmoTakeInfo>(64);
    sized::<UmoGestureOptions>(48);
    sized::<UmoGestureClip>(32);
    sized::<UmoClip>(72);
    sized::<UmoRig>(128);
    assert_eq!(size_of::<UmoOutput>(), 16);
    assert_eq!((size_of::<UmoAllocator>(), size_of::<UmoJobs>(), size_of::<UmoLog>()), (24, 16, 16));
    assert_eq!(offset_of!(UmoModelInfo, file_size), 56);
    assert_eq!(offset_of!(UmoEngineConfig, jobs), 32);
    assert_eq!(offset_of!(UmoEngineConfig, priority), 48);
    assert_eq!(offset_of!(UmoSessionConfig, seed), 40);
    assert_eq!(offset_of!(UmoSessionConfig, template_name), 48);
    assert_eq!(offset_of!(UmoSessionConfig, smoothing), 64);
    assert_eq!(offset_of!(UmoSessionConfig, horizon), 72);
    assert_eq!(offset_of!(UmoSessionConfig, reorder_window), 84);
    assert_eq!(offset_of!(UmoFrameLayout, visemes), 40);
    assert_eq!(offset_of!(UmoParameterInfo, minimum), 16);
    assert_eq!(offset_of!(UmoClip, channels), 24);
    assert_eq!(offset_of!(UmoLatency, algorithmic_samples), 8);
}
