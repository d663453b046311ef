//! The server's character in a client's frames.

use std::sync::Arc;

use umo_core::Pose;
use umo_core_rig::glb::{FollowScratch, Follower};

use super::End;
use crate::config::Config;
use crate::protocol::{Hello, Output};

/// The server's character, and the values of its channels in a frame.
#[derive(Debug)]
pub(super) struct Character {
    follower: Arc<Follower>,
    scratch: FollowScratch,
    values: Vec<f32>,
}

impl Character {
    /// Returns the server's character, if the hello asks for it.
    pub(super) fn of(hello: &Hello, config: &Config) -> Result<Option<Self>, End> {
        if !hello.character {
            return Ok(None);
        }
        if hello.output == Output::Packets {
            return Err(End::bad("character: packets have no frames that could hold its values"));
        }
        let follower = config.page.as_ref().and_then(|page| page.follower());
        let follower = follower.ok_or_else(|| End::bad("character: this server shows none"))?;
        Ok(Some(Self { scratch: follower.scratch(), follower, values: Vec::new() }))
    }

    /// Returns the values in a frame.
    pub(super) fn values(&mut self, pose: &Pose, face: &[f32]) -> Result<&[f32], End> {
        self.values.clear();
        self.follower.add(&mut self.scratch, pose, face, &mut self.values).map_err(End::internal)?;
        Ok(&self.values)
    }
}
