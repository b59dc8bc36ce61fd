//! Every policy by its name: a new one is a file in `env/src/policy`, a variant and an arm here.

use crate::checkpoint::Settings;
use nbp_env::nbv::{NbvConfig, NbvPredictor};
use nbp_env::policy::fbe::{self, Fbe};
use nbp_env::policy::nbp::{Nbp, NbpConfig, Passability};
use nbp_env::policy::oracle::{OracleLooks, OracleObstacles};
use nbp_env::policy::scone::Scone;
use nbp_env::policy::search::{OracleSearch, SearchConfig, SearchConfigError};
use nbp_env::policy::{Plan, PolicyError, random::Random, random_nbv::RandomNbv};
use nbp_env::{Action, MapView, Motion, Policy, Predictor, Rng, World};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// The policies that can be run and compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PolicyKind {
    /// A uniformly drawn move and heading.
    Random,
    /// A uniformly drawn move with a turn of at most 135°.
    RandomNbv,
    /// The nearest frontier.
    Fbe,
    /// The frontier with the most cells for its way.
    FbeGain,
    /// The first frontier of a tour that finds much early.
    FbeTsp,
    /// The next best view, by networks that learnt from the truth.
    Scone,
    /// The next best view, by networks that learnt from what they saw.
    Macarons,
    /// The network's value and obstacle maps.
    Nbp,
    /// The network's value map on the true obstacle map (paper, Table 4).
    OracleObstacles,
    /// The true gains of looks, on the network's obstacle map.
    OracleLooks,
    /// Both: what is left is the fault of neither map.
    OracleMaps,
    /// One step ahead on the true gains, and the best place for what comes after.
    OracleGreedy,
    /// The same, ten steps ahead.
    OracleBeam,
}

/// What policies are built from.
#[derive(Clone, Default)]
pub struct PolicyContext {
    /// The network, for the policies that need one.
    pub predictor: Option<Arc<dyn Predictor>>,
    /// How value and obstacle maps become paths.
    pub nbp: NbpConfig,
    /// How far `oracle-beam` looks ahead.
    pub search: SearchConfig,
    /// The networks of `scone`.
    pub scone: Option<NbvNetworks>,
    /// The networks of `macarons`.
    pub macarons: Option<NbvNetworks>,
}

/// The networks of a next-best-view baseline, and what they are asked.
#[derive(Clone)]
pub struct NbvNetworks {
    /// The networks.
    pub predictor: Arc<dyn NbvPredictor>,
    /// Sizes and distances that they were trained with.
    pub config: NbvConfig,
}

/// A checkpoint's network behind its seam.
#[derive(Clone)]
pub enum Network {
    /// Of `nbp`.
    Maps(Arc<dyn Predictor>),
    /// Of `scone` or `macarons`.
    Views(Arc<dyn NbvPredictor>),
}

impl PolicyContext {
    /// Of settings, for policies without a network.
    pub fn new(settings: &Settings) -> Self {
        Self { nbp: settings.policy, search: settings.search, ..Self::default() }
    }

    /// The same with a network for policies of this kind, which those of next best views ask so.
    #[must_use]
    pub fn with(mut self, kind: PolicyKind, network: Network, config: NbvConfig) -> Self {
        match network {
            Network::Maps(predictor) => self.predictor = Some(predictor),
            Network::Views(predictor) if kind == PolicyKind::Macarons => {
                self.macarons = Some(NbvNetworks { predictor, config });
            }
            Network::Views(predictor) => self.scone = Some(NbvNetworks { predictor, config }),
        }
        self
    }
}

/// A policy that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum RegistryError {
    /// Not one of the names.
    #[error("no policy is called `{name}`: use one of {known}", known = PolicyKind::names())]
    Unknown {
        /// As given.
        name: String,
    },
    /// It asks a network, and there is none.
    #[error(
        "policy {0} needs a network: give a checkpoint of {net} (--checkpoint DIR)",
        net = .0.architecture().unwrap_or("it")
    )]
    NeedsNetwork(PolicyKind),
    /// It cannot search so.
    #[error(transparent)]
    Search(#[from] SearchConfigError),
}

impl PolicyKind {
    /// All policies, baselines first.
    pub const ALL: [Self; 13] = [
        Self::Random,
        Self::RandomNbv,
        Self::Fbe,
        Self::FbeGain,
        Self::FbeTsp,
        Self::Scone,
        Self::Macarons,
        Self::Nbp,
        Self::OracleObstacles,
        Self::OracleLooks,
        Self::OracleMaps,
        Self::OracleGreedy,
        Self::OracleBeam,
    ];

    /// Name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::RandomNbv => "random-nbv",
            Self::Fbe => "fbe",
            Self::FbeGain => "fbe-gain",
            Self::FbeTsp => "fbe-tsp",
            Self::Scone => "scone",
            Self::Macarons => "macarons",
            Self::Nbp => "nbp",
            Self::OracleObstacles => "oracle-obstacles",
            Self::OracleLooks => "oracle-looks",
            Self::OracleMaps => "oracle-maps",
            Self::OracleGreedy => "oracle-greedy",
            Self::OracleBeam => "oracle-beam",
        }
    }

    /// All names, for messages.
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }

    /// Whether it asks a network.
    pub fn needs_network(self) -> bool {
        self.architecture().is_some()
    }

    /// Whether it is told of the true map.
    pub fn knows_map(self) -> bool {
        matches!(
            self,
            Self::OracleObstacles | Self::OracleLooks | Self::OracleMaps | Self::OracleGreedy | Self::OracleBeam
        )
    }

    /// The architecture of the checkpoint that it needs, if any.
    pub fn architecture(self) -> Option<&'static str> {
        match self {
            Self::Nbp | Self::OracleObstacles | Self::OracleLooks | Self::OracleMaps => Some("nbp"),
            Self::Scone => Some("scone"),
            Self::Macarons => Some("macarons"),
            _ => None,
        }
    }
}

impl FromStr for PolicyKind {
    type Err = RegistryError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let unknown = || RegistryError::Unknown { name: name.to_owned() };
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(unknown)
    }
}

impl fmt::Display for PolicyKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A policy ready for episodes in `world`. It answers to the name of its kind.
///
/// # Errors
/// When it needs a network and the context has none, or a setting is out of range.
pub fn build(kind: PolicyKind, context: &PolicyContext, world: &Arc<World>) -> Result<Box<dyn Policy>, RegistryError> {
    let network = || context.predictor.clone().ok_or(RegistryError::NeedsNetwork(kind));
    let nbp = |predictor: Arc<dyn Predictor>| {
        let passability = Passability::in_inference(&context.nbp, world);
        Nbp::new(predictor, context.nbp, passability)
    };
    let nbv = |networks: &Option<NbvNetworks>| {
        let NbvNetworks { predictor, config } = networks.clone().ok_or(RegistryError::NeedsNetwork(kind))?;
        Ok::<_, RegistryError>(Named { kind, inner: Scone::new(predictor, config, world) })
    };
    Ok(match kind {
        PolicyKind::Random => Box::new(Random),
        PolicyKind::RandomNbv => Box::new(RandomNbv),
        PolicyKind::Fbe => Box::new(Fbe::new(fbe::Rule::Nearest)),
        PolicyKind::FbeGain => Box::new(Fbe::new(fbe::Rule::Gain)),
        PolicyKind::FbeTsp => Box::new(Fbe::new(fbe::Rule::Tsp)),
        PolicyKind::Scone => Box::new(nbv(&context.scone)?),
        PolicyKind::Macarons => Box::new(nbv(&context.macarons)?),
        PolicyKind::Nbp => Box::new(nbp(network()?)),
        PolicyKind::OracleGreedy => Box::new(OracleSearch::greedy(Arc::clone(world))),
        PolicyKind::OracleBeam => {
            context.search.validate()?;
            Box::new(OracleSearch::beam(Arc::clone(world), context.search))
        }
        PolicyKind::OracleLooks => Box::new(OracleLooks::new(network()?, Arc::clone(world), nbp)),
        PolicyKind::OracleObstacles => {
            let oracle = OracleObstacles::new(network()?, Arc::clone(world));
            Box::new(Named { kind, inner: nbp(Arc::new(oracle)) })
        }
        PolicyKind::OracleMaps => {
            let obstacles = Arc::new(OracleObstacles::new(network()?, Arc::clone(world)));
            Box::new(Named { kind, inner: OracleLooks::new(obstacles, Arc::clone(world), nbp) })
        }
    })
}

/// A policy made of another one under a name of its own.
struct Named<P> {
    kind: PolicyKind,
    inner: P,
}

impl<P: Policy> Policy for Named<P> {
    fn name(&self) -> &'static str {
        self.kind.name()
    }

    fn begin(&mut self) {
        self.inner.begin();
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        self.inner.act(view, rng)
    }

    fn motion(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Option<Motion>, PolicyError> {
        self.inner.motion(view, rng)
    }

    fn plan(&self) -> Option<&Plan> {
        self.inner.plan()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use nbp_env::nbv::{CandidateInput, OccupancyInput};
    use nbp_env::{EncoderInput, ObstacleMap, PredictError, Prediction, Scene, SimConfig, ValueMap};

    /// Promises most far from the start and sees no walls: a network's stand-in.
    pub(crate) struct Wanderer;

    impl Predictor for Wanderer {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let answer = |input: &EncoderInput| {
                let (pixels, size) = (input.size(), input.size() / 4);
                let gain = |n: usize| (n / size % size).abs_diff(size / 2) as f32 + (n % 3) as f32;
                Prediction {
                    value: ValueMap { size, gain: (0..8 * size * size).map(gain).collect() },
                    obstacle: ObstacleMap { size: pixels, probability: vec![0.1; pixels * pixels] },
                }
            };
            Ok(inputs.iter().map(answer).collect())
        }
    }

    /// Expects most where most may be.
    struct Mass;

    impl NbvPredictor for Mass {
        fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
            Ok(inputs.iter().map(|input| vec![0.5; input.queries.len()]).collect())
        }

        fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
            Ok(candidates.iter().map(|candidate| candidate.mass).collect())
        }
    }

    pub(crate) fn with_network() -> PolicyContext {
        let mass = Some(NbvNetworks { predictor: Arc::new(Mass), config: NbvConfig::default() });
        let (scone, macarons) = (mass.clone(), mass);
        PolicyContext { predictor: Some(Arc::new(Wanderer)), scone, macarons, ..PolicyContext::default() }
    }

    #[test]
    fn names_round_trip_and_policies_answer_to_them() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        for kind in PolicyKind::ALL {
            assert_eq!(kind.to_string().parse::<PolicyKind>().unwrap(), kind);
            assert_eq!(build(kind, &with_network(), &world).unwrap().name(), kind.name());
            let blind = build(kind, &PolicyContext::default(), &world);
            assert_eq!(blind.is_err(), kind.needs_network());
            if let (Err(error), Some(net)) = (blind, kind.architecture()) {
                assert!(error.to_string().contains(&format!("a checkpoint of {net}")), "{error}");
            }
        }
        let search = SearchConfig { width: 0, ..SearchConfig::default() };
        let blind = PolicyContext { search, ..PolicyContext::default() };
        let error = build(PolicyKind::OracleBeam, &blind, &world).err().unwrap().to_string();
        assert!(error.contains("search.width is 0: it must be 1 to"), "{error}");
        assert!(build(PolicyKind::OracleGreedy, &blind, &world).is_ok());
        let error = "greedy".parse::<PolicyKind>().unwrap_err().to_string();
        assert!(
            error.contains("random, random-nbv, fbe, fbe-gain, fbe-tsp, scone, macarons, nbp, oracle-obstacles"),
            "{error}"
        );
    }
}
