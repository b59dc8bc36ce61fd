//! An episode as a film: the map as it grows, the way, the plan, what the agent sees, and the value map it plans on.

use super::gif::{Gif, GifError};
use super::topdown::{Plan, draw_map, flat};
use super::{Rgb, colour, value_map};
use glam::Vec2;
use nbp_dataset::draw::text_width;
use nbp_env::policy::{self, Policy};
use nbp_env::sensor::Frame;
use nbp_env::{Episode, Prediction};

/// More frames than this, and steps are left out.
const MOST_FRAMES: usize = 150;
/// Space around the parts, pixels.
const GAP: f32 = 16.0;
const HEAD: f32 = 62.0;
/// Side of the map.
const MAP: f32 = 480.0;
/// Width of the views beside it.
const SIDE: usize = 256;
const CAPTION: f32 = 20.0;
/// Hundredths of a second that a step is shown, and the last one.
const TIME: [u16; 2] = [12, 300];

/// A film in the making.
pub struct Film {
    title: String,
    gif: Gif,
    plan: Plan,
    horizon: usize,
    frame: Frame,
}

impl Film {
    /// Of an episode at its start that is to take `horizon` steps.
    ///
    /// # Errors
    /// Never for the size that films have; see [`Gif::new`].
    pub fn new(title: &str, episode: &Episode, horizon: usize) -> Result<Self, GifError> {
        let [width, height] = size();
        Ok(Self {
            title: title.to_owned(),
            gif: Gif::new(width, height)?,
            plan: Plan::within(episode, Vec2::new(GAP, HEAD), MAP),
            horizon,
            frame: Frame::default(),
        })
    }

    /// Takes the episode as it is now, if this step is among those that are shown.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn take(&mut self, episode: &Episode, policy: &dyn Policy) -> Result<(), GifError> {
        let step = episode.steps();
        if !is_shown(step, self.horizon) {
            return Ok(());
        }
        let picture = self.draw(episode, policy.plan());
        self.gif.push(&picture, TIME[usize::from(step >= self.horizon)])
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn finish(self) -> Result<Vec<u8>, GifError> {
        self.gif.finish()
    }

    fn draw(&mut self, episode: &Episode, plan: Option<&policy::Plan>) -> Rgb {
        let [width, height] = size();
        let mut image = Rgb::filled(width, height, colour::BACKGROUND);
        self.draw_head(&mut image, episode);
        draw_map(&mut image, &self.plan, episode);
        self.draw_way(&mut image, episode, plan);
        let left = 2.0 * GAP + MAP;
        image.text("what the agent sees", Vec2::new(left, HEAD), 9.5, colour::FAINT);
        let view = self.view(episode);
        image.paste(&view, left as usize, (HEAD + CAPTION) as usize);
        let top = HEAD + 2.0 * CAPTION + view.height as f32;
        let thought = plan.and_then(|plan| Some((plan, plan.thought.as_ref()?)));
        match thought {
            Some((plan, (input, Prediction { value, .. }))) => {
                image.text("predicted gain, and the plan", Vec2::new(left, top), 9.5, colour::FAINT);
                let lattice = episode.world().scene().lattice();
                let drawn = value_map(&input.window, value, &[], lattice, &plan.path).shrunk(2);
                let mut square = Rgb::filled(SIDE, SIDE, colour::BACKGROUND);
                square.paste(&drawn, 0, 0);
                image.paste(&square, left as usize, (top + CAPTION) as usize);
            }
            None => {
                image.text("covered over time", Vec2::new(left, top), 9.5, colour::FAINT);
                self.draw_curve(&mut image, Vec2::new(left, top + CAPTION), episode.curve());
            }
        }
        image
    }

    fn draw_head(&self, image: &mut Rgb, episode: &Episode) {
        let share = episode.curve().last().copied().unwrap_or(0.0);
        let facts = format!("step {} of {}   {:.1} % covered", episode.steps(), self.horizon, 100.0 * share);
        image.text(&self.title, Vec2::new(GAP, 16.0), 12.5, colour::TEXT);
        let right = image.width as f32 - GAP;
        image.text(&facts, Vec2::new(right - text_width(&facts, 12.5), 16.0), 12.5, colour::TEXT);
        let bar = |from: f32, to: f32| [from, to].map(|share| Vec2::new(GAP + (right - GAP) * share, 44.0));
        for (ends, ink) in [(bar(0.0, 1.0), colour::FREE), (bar(0.0, share), colour::PLAN)] {
            image.line(ends[0], ends[1], 4.0, ink, 1.0);
        }
    }

    fn draw_way(&self, image: &mut Rgb, episode: &Episode, plan: Option<&policy::Plan>) {
        let track = episode.track();
        let at = |n: usize| self.plan.pixel(flat(track[n].position));
        for n in (1..track.len()).filter(|&n| track[n].position != track[n - 1].position) {
            image.line(at(n - 1), at(n), 3.0, colour::time(n as f32 / self.horizon.max(1) as f32), 1.0);
        }
        let Some(last) = track.last() else { return };
        let (agent, lattice) = (self.plan.pixel(flat(last.position)), episode.world().scene().lattice());
        let mut from = agent;
        // What is left of the plan: it was made some steps ago.
        let path = plan.map_or(&[][..], |plan| &plan.path);
        let done = path.iter().position(|&pose| pose == episode.pose()).map_or(0, |n| n + 1);
        for pose in &path[done..] {
            let to = self.plan.pixel(flat(lattice.position(pose.node)));
            dotted(image, from, to);
            from = to;
        }
        if done < path.len() {
            image.ring(from, 5.0, 2.0, colour::PLAN);
        }
        let (ahead, aside) =
            (Vec2::new(-last.azimuth.sin(), -last.azimuth.cos()), Vec2::new(last.azimuth.cos(), -last.azimuth.sin()));
        let corner = |along: f32, across: f32| agent + along * ahead + across * aside;
        image.triangle([corner(10.0, 0.0), corner(-6.0, 6.0), corner(-6.0, -6.0)], colour::BACKGROUND, 0.8);
        image.triangle([corner(8.0, 0.0), corner(-4.5, 4.5), corner(-4.5, -4.5)], colour::TEXT, 1.0);
    }

    /// Near is bright.
    fn view(&mut self, episode: &Episode) -> Rgb {
        let world = episode.world();
        world.sensor().capture(world.scene(), &episode.camera(), &mut self.frame);
        let height = (SIDE * self.frame.height / self.frame.width.max(1)).max(1);
        let mut image = Rgb::filled(SIDE, height, colour::BACKGROUND);
        for (x, y) in (0..height).flat_map(|y| (0..SIDE).map(move |x| (x, y))) {
            let (column, row) = (x * self.frame.width / SIDE, y * self.frame.height / height);
            if let Some(depth) = self.frame.at(column, row) {
                image.set(x, y, colour::mix(colour::TEXT, colour::BACKGROUND, (depth / (depth + 6.0)).powf(0.8)));
            }
        }
        image
    }

    fn draw_curve(&self, image: &mut Rgb, corner: Vec2, curve: &[f32]) {
        let side = SIDE as f32;
        for tenth in (0..=10).step_by(5) {
            let y = corner.y + side * (1.0 - tenth as f32 / 10.0);
            image.line(Vec2::new(corner.x, y), Vec2::new(corner.x + side, y), 1.0, colour::FREE, 1.0);
        }
        let at = |n: usize| corner + side * Vec2::new(n as f32 / self.horizon.max(1) as f32, 1.0 - curve[n]);
        for n in 1..curve.len() {
            image.line(at(n - 1), at(n), 2.0, colour::PLAN, 1.0);
        }
    }
}

/// Every so many steps, and the last.
fn is_shown(step: usize, horizon: usize) -> bool {
    step.is_multiple_of(horizon.div_ceil(MOST_FRAMES).max(1)) || step >= horizon
}

fn size() -> [usize; 2] {
    [(3.0 * GAP + MAP) as usize + SIDE, (HEAD + MAP + GAP) as usize]
}

fn dotted(image: &mut Rgb, from: Vec2, to: Vec2) {
    let dots = (from.distance(to) / 5.0).ceil().clamp(1.0, 1e3) as usize;
    for n in 1..=dots {
        image.disc(from.lerp(to, n as f32 / dots as f32), 1.2, colour::PLAN, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::{self, PolicyKind, tests::with_network};
    use crate::rollout::{Trial, run_episode};
    use nbp_env::{Scene, SimConfig, World};
    use std::sync::Arc;

    /// Frames of the film of an episode, and its bytes.
    fn film(kind: PolicyKind, steps: usize) -> (usize, Vec<u8>) {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let mut policy = registry::build(kind, &with_network(), &world).unwrap();
        let mut film = None;
        run_episode(&world, policy.as_mut(), Trial { start: 0, seed: 3, steps }, |episode, policy| {
            film.get_or_insert_with(|| Film::new("rooms", episode, steps).unwrap()).take(episode, policy).unwrap();
            Ok(())
        })
        .unwrap();
        let bytes = film.unwrap().finish().unwrap();
        let mut reader = gif::DecodeOptions::new().read_info(&bytes[..]).unwrap();
        let mut frames = 0;
        while reader.next_frame_info().unwrap().is_some() {
            frames += 1;
        }
        (frames, bytes)
    }

    #[test]
    fn every_step_is_a_frame_and_the_same_walk_the_same_bytes() {
        for kind in [PolicyKind::Fbe, PolicyKind::Nbp] {
            let (frames, bytes) = film(kind, 5);
            assert_eq!(frames, 6, "{kind}");
            assert!(bytes.len() < 6 * 40_000, "{kind}: {} bytes", bytes.len());
            assert_eq!(film(kind, 5).1, bytes);
        }
    }

    #[test]
    fn long_walks_skip_steps_and_show_the_last() {
        for horizon in [0, 1, MOST_FRAMES, MOST_FRAMES + 1, 500, 1000] {
            let shown: Vec<usize> = (0..=horizon).filter(|&step| is_shown(step, horizon)).collect();
            assert!(shown.len() <= MOST_FRAMES + 2 && shown[0] == 0 && shown.last() == Some(&horizon), "{horizon}");
            assert!(horizon > MOST_FRAMES || shown.len() == horizon + 1);
        }
    }
}
