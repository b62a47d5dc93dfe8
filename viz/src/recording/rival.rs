//! A race: another law's arm beside the one that is recorded.

use glam::Vec3;
use nalgebra::SVector;
use re_sdk_types::archetypes::TextDocument;

use super::columns::Track;
use super::pieces::ghost3d;
use super::state::{Recording, Rival};
use crate::arm::{placement, vec3};
use crate::entity;

impl Recording {
    /// Takes in where the other law's arm is at a tick, joint positions in rad, and Markdown that compares both so far. At the rate of the
    /// picture, before the tick of the same number. The words replace those about singularities.
    pub fn rival(&mut self, tick: u64, q: &[f64], words: &str) {
        if self.rival.is_none() {
            for i in 0..self.run.figure.links.len() {
                // A little inside the solid arm, which hides it where both are in one place.
                let mut mesh = self.run.figure.links[i].clone();
                let inwards = -0.004 * self.run.figure.reach;
                for (p, normal) in mesh.positions.iter_mut().zip(&mesh.normals) {
                    *p = (Vec3::from_array(*p) + inwards * Vec3::from_array(*normal)).to_array();
                }
                let pale = ghost3d(&mesh, [255, 80, 70, 140]);
                self.log_static(entity::rival_link(i), &pale);
            }
            self.rival = Some(Rival::default());
        }
        let mut q_all = SVector::zeros();
        q.iter()
            .take(self.subject.joints)
            .enumerate()
            .for_each(|(i, value)| q_all[i] = *value);
        let links = self.run.arm.link_poses(&q_all).map(|X| placement(&X));
        let hand = vec3(&self.run.arm.forward_kinematics(&q_all).p);
        let Some(rival) = &mut self.rival else { return };
        rival
            .links
            .resize_with(self.run.figure.links.len(), Track::default);
        rival
            .links
            .iter_mut()
            .zip(&links)
            .for_each(|(track, at)| track.push(tick, at));
        rival.path.push((tick, hand));
        if rival.words != words {
            words.clone_into(&mut rival.words);
            self.log(tick, entity::NOW, &TextDocument::from_markdown(words));
        }
    }
}
