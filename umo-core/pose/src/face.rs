//! Face channels of a pose.

use serde::{Deserialize, Serialize};

/// Face channels (SPEC 2.7, 3).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Face {
    /// Kind of the channels after the jaw's six.
    pub kind: FaceKind,
    /// Names of those channels.
    pub names: Vec<String>,
}

/// Kind of face channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaceKind {
    /// SMPL-X expression coefficients, unbounded.
    SmplxExpression,
    /// The 52 ARKit blendshapes, 0 to 1.
    Arkit,
}
