//! Calls of a [scene](crate::scene) on a session.

use umo_core_layers::Company;

use super::shared::try_lock;
use super::{Session, spin_lock};

impl Session {
    /// Index of the frame shown last and level of its sound, full scale 1; `None` before the first frame, and while another
    /// thread pulls.
    pub(crate) fn voice_shown(&self) -> Option<(u64, f32)> {
        try_lock(&self.shared.output)?.voice(&self.shared)
    }

    /// Takes the company over with the next frame; returns whether it could be left for it.
    pub(crate) fn keep_company(&self, company: &Company) -> bool {
        let handover = &self.shared.host.company;
        let Some(mut value) = try_lock(&handover.value) else { return false };
        *value = *company;
        drop(value);
        handover.changed();
        true
    }

    /// Is alone from the next frame on.
    pub(crate) fn leave_company(&self) {
        let handover = &self.shared.host.company;
        if let Ok(mut value) = spin_lock(&handover.value) {
            *value = Company::ALONE;
            drop(value);
            handover.changed();
        }
    }
}
