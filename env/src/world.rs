//! A scene with all that its episodes share: ground truth, sensor, settings, and what each pose sees.

use crate::config::{SimConfig, SimError};
use crate::coverage::Surface;
use crate::encode::EncodeConfig;
use crate::motion::Agent;
use crate::pose::{HEADINGS, Heading, LatticePose, Node};
use crate::scene::slice::ObstacleGrid;
use crate::scene::{Scene, surface};
use crate::seed::SeedTree;
use crate::sensor::{RgbdCamera, Sensor};
use crate::visibility::{Visibility, VisibilityCache};
use glam::Vec3;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;
use std::fmt;
use std::sync::{Arc, OnceLock};

/// A scene with all that its episodes share. Built once, used by many threads.
pub struct World {
    scene: Arc<Scene>,
    surface: Arc<Surface>,
    area: f32,
    obstacles: ObstacleGrid,
    sensor: Arc<dyn Sensor>,
    config: SimConfig,
    visibility: Arc<OnceLock<VisibilityCache>>,
    glimpses: Arc<OnceLock<VisibilityCache>>,
}

impl World {
    /// Prepares a scene for episodes, with a lattice laid anew where the agent is continuous.
    ///
    /// # Errors
    /// When a setting is out of range, the scene has no surface to cover, or no room for the agent.
    pub fn new(scene: Scene, config: &SimConfig) -> Result<Self, SimError> {
        Self::with_sensor(scene, config, Box::new(RgbdCamera { camera: config.camera, colour: config.colour }))
    }

    /// The same with a sensor of one's own, whose camera replaces that of the settings; see
    /// [`check_sensor`](crate::check::check_sensor).
    ///
    /// # Errors
    /// As [`World::new`].
    pub fn with_sensor(scene: Scene, config: &SimConfig, sensor: Box<dyn Sensor>) -> Result<Self, SimError> {
        let config = SimConfig { camera: *sensor.camera(), ..config.clone() };
        config.validate()?;
        let scene = match &config.agent {
            Agent::Lattice {} => scene,
            Agent::Continuous(agent) => scene.for_robot(agent.camera_height, agent.lattice_step, agent.clearance())?,
        };
        let surface = Surface::of(&scene, &config.coverage);
        if surface.is_empty() {
            let [low, high] = scene.bounds();
            return Err(SimError::NoSurface { scene: scene.name().into(), low, high });
        }
        Ok(Self {
            surface: Arc::new(surface),
            area: surface::area(&scene),
            obstacles: ObstacleGrid::draw(scene.walls(), config.encode.window),
            sensor: Arc::from(sensor),
            config,
            visibility: Arc::default(),
            glimpses: Arc::default(),
            scene: Arc::new(scene),
        })
    }

    /// The same world for agents whose network sees it in another way; the rest, and what is computed of it, is shared.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn with_encode(&self, encode: EncodeConfig) -> Result<Self, SimError> {
        let config = SimConfig { encode, ..self.config.clone() };
        config.validate()?;
        Ok(Self {
            scene: Arc::clone(&self.scene),
            surface: Arc::clone(&self.surface),
            area: self.area,
            obstacles: ObstacleGrid::draw(self.scene.walls(), encode.window),
            sensor: Arc::clone(&self.sensor),
            config,
            visibility: Arc::clone(&self.visibility),
            glimpses: Arc::clone(&self.glimpses),
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Ground-truth surface points.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Area of the surface that counts, square metres.
    pub fn area(&self) -> f32 {
        self.area
    }

    /// Ground-truth obstacles of the camera plane.
    pub fn obstacles(&self) -> &ObstacleGrid {
        &self.obstacles
    }

    /// A pose drawn from the nodes of the largest connected component and all headings: where [`Episode::reset`](crate::Episode::reset) starts.
    pub fn random_start(&self, seed: SeedTree) -> LatticePose {
        let mut rng = seed.child("start", 0).rng();
        // A scene without a free node is refused, so the first start is never asked for.
        let nodes = self.scene.graph().largest_component();
        let node = nodes.choose(&mut rng).copied().unwrap_or(self.scene.starts()[0].node);
        LatticePose { node, heading: Heading::new(rng.random_range(0..HEADINGS)) }
    }

    /// Whether an agent can stand there.
    ///
    /// # Errors
    /// Naming the node that is outside the lattice or not free.
    pub fn check_start(&self, LatticePose { node, .. }: LatticePose) -> Result<(), StartError> {
        let (scene, lattice) = (self.scene.name(), self.scene.lattice());
        if !lattice.contains(node) {
            return Err(StartError::Outside { scene: scene.into(), node, size: lattice.size });
        }
        match self.scene.graph().is_free(node) {
            true => Ok(()),
            false => Err(StartError::Blocked { scene: scene.into(), node, position: lattice.position(node) }),
        }
    }

    /// What its lattice poses see. Nothing is computed before it is asked for.
    pub fn visibility(&self) -> Visibility<'_> {
        let new = || VisibilityCache::new(self.surface.points(), self.scene.lattice(), 1.0);
        Visibility::new(self, self.visibility.get_or_init(new))
    }

    /// What one frame of an episode covers from its lattice poses, where only a share of the pixels is kept
    /// ([`SimConfig::keep`]): for each pose one draw, always the same.
    pub fn glimpses(&self) -> Visibility<'_> {
        let new = || VisibilityCache::new(self.surface.points(), self.scene.lattice(), self.config.keep);
        Visibility::new(self, self.glimpses.get_or_init(new))
    }

    /// What its episodes see with.
    pub fn sensor(&self) -> &dyn Sensor {
        &*self.sensor
    }

    /// Settings.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }
}

impl fmt::Debug for World {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scene, points) = (self.scene.name(), self.surface.len());
        f.debug_struct("World").field("scene", &scene).field("points", &points).finish_non_exhaustive()
    }
}

/// A start pose where no agent can stand.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Not a node of the lattice.
    #[error(
        "scene {scene}: start ({}, {}) is outside the lattice, which has nodes from (0, 0) to ({}, {}): take one of \
         Scene::starts or World::random_start", node.i, node.k, size[0] - 1, size[1] - 1
    )]
    Outside {
        /// Scene name.
        scene: String,
        /// As given.
        node: Node,
        /// Nodes along `x` and `z`.
        size: [i32; 2],
    },
    /// A node that is not free.
    #[error(
        "scene {scene}: start ({}, {}) at {position:.2} m is in a wall or outside the building: take one of Scene::starts \
         or World::random_start", node.i, node.k
    )]
    Blocked {
        /// Scene name.
        scene: String,
        /// As given.
        node: Node,
        /// Where the camera would be, metres.
        position: Vec3,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;
    use crate::sensor::{Camera, Frame};
    use crate::{Action, Episode};
    use std::sync::Arc;

    fn start(i: i32, k: i32) -> LatticePose {
        LatticePose { node: Node { i, k }, heading: Heading::new(0) }
    }

    #[test]
    fn nobody_starts_in_a_wall() {
        let (mesh, mut settings) = crate::scene::two_rooms();
        settings.camera.pose_l = 10;
        let world = Arc::new(World::new(Scene::new("rooms", mesh, &settings).unwrap(), &SimConfig::default()).unwrap());
        let begin = |start| Episode::new(Arc::clone(&world), start, 3, SeedTree::new(1));
        let error = begin(start(10, 2)).err().unwrap().to_string();
        assert!(error.contains("rooms: start (10, 2) is outside the lattice") && error.contains("(9, 5)"), "{error}");
        let error = begin(start(9, 2)).err().unwrap().to_string();
        assert!(error.contains("start (9, 2) at [14.25, 1.65, 3.75] m is in a wall or outside"), "{error}");
        let mut episode = begin(start(1, 2)).unwrap();
        episode.step(Action { direction: None, heading: Heading::new(1) });
        assert!(episode.reset_at(start(-1, 0), SeedTree::new(1)).is_err());
        assert_eq!(episode.steps(), 1, "it stays as it was");
    }

    #[test]
    fn another_window_is_all_that_differs() {
        let mut encode = EncodeConfig::default();
        encode.window.pixels = 32;
        let world = World::new(Scene::two_rooms(), &SimConfig::default()).unwrap();
        let shared = world.with_encode(encode).unwrap();
        let apart = World::new(Scene::two_rooms(), &SimConfig { encode, ..SimConfig::default() }).unwrap();
        assert_eq!(shared.config(), apart.config());
        let [first, second] = [shared, apart].map(|world| {
            let mut episode = Episode::random(Arc::new(world), 3, SeedTree::new(1));
            episode.step(Action { direction: None, heading: Heading::new(1) });
            (episode.curve().to_vec(), episode.encode())
        });
        assert_eq!(first, second);
        encode.window.pixels = 33;
        assert!(world.with_encode(encode).unwrap_err().to_string().contains("encode.window.pixels"));
    }

    #[test]
    fn episodes_see_with_a_sensor_of_ones_own() {
        /// Everything stands at arm's length, or is no distance at all.
        struct Fog(Camera);

        impl Sensor for Fog {
            fn camera(&self) -> &Camera {
                &self.0
            }

            fn capture(&self, _: &Scene, _: &Pose, out: &mut Frame) {
                (out.width, out.height) = (self.0.width, self.0.height);
                out.depth = [0.5, f32::NAN, 0.5, f32::INFINITY].repeat(self.0.width * self.0.height / 4);
            }
        }

        let camera = Camera { width: 32, height: 24, ..Camera::default() };
        let world =
            World::with_sensor(Scene::two_rooms(), &SimConfig::default(), Box::new(Fog(camera))).map(Arc::new).unwrap();
        assert_eq!(world.config().camera, camera);
        let episode = Episode::random(Arc::clone(&world), 1, SeedTree::new(0));
        let eye = episode.camera().position;
        assert!(
            episode.view().cloud().iter().all(|point| point.distance(eye) < 1.0) && !episode.view().cloud().is_empty()
        );
        let refused =
            World::with_sensor(Scene::two_rooms(), &SimConfig::default(), Box::new(Fog(Camera { width: 0, ..camera })));
        assert!(refused.unwrap_err().to_string().contains("camera.width"));
    }
}
