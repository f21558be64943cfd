//! The messages between the page and the server, as JSON text. Pictures are binary, see [`super::picture`].

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

/// A message of the page.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub enum Request {
    /// The first message, with the token of the address.
    Hello { token: String },
    /// Changes settings by the names of their flags: all of them or, if one fails, none. `number` counts such messages of the page.
    Set {
        changes: BTreeMap<String, Change>,
        #[serde(default)]
        number: u32,
    },
    /// Pauses the render, or goes on.
    Pause { on: bool },
    /// The picture that this page wants to see.
    Show { layer: Layer, response: u32 },
    /// The page has received a picture, so the server may send the next one.
    Ack { frame: u32 },
    /// Asks for the values of a pixel of the whole image.
    Pixel { x: u32, y: u32 },
    /// Saves the image so far under this name.
    Save { name: String },
}

impl Request {
    /// Fails with a sentence for the page if the text is no message.
    pub fn parse(text: &str) -> Result<Request, String> {
        serde_json::from_str(text).map_err(|e| format!("the program does not understand this message of the page: {e}"))
    }
}

/// The new value of a setting.
#[derive(Debug, Clone, PartialEq)]
pub enum Change {
    /// JSON null: the value that the viewer started with.
    AsAtStart,
    /// JSON false: the flag is not given.
    LeaveOut,
    /// The value as on the command line; JSON true for a switch.
    Text(String),
}

impl<'de> Deserialize<'de> for Change {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Change, D::Error> {
        match Json::deserialize(deserializer)? {
            Json::Null => Ok(Change::AsAtStart),
            Json::Bool(false) => Ok(Change::LeaveOut),
            Json::Bool(true) => Ok(Change::Text("true".into())),
            Json::String(text) => Ok(Change::Text(text)),
            _ => Err(serde::de::Error::custom("a value is text, true, false or null")),
        }
    }
}

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Layer {
    /// The radiance.
    Mean,
    /// The standard error of the luminance, relative to the luminance.
    Error,
    /// The length of the camera ray. As long as it is not known, the picture shows the radiance.
    Depth,
    /// The normals of the surfaces, as for [`Layer::Depth`].
    Normal,
}

/// A message of the server.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "is", rename_all = "lowercase")]
pub enum Report {
    Welcome(Welcome),
    State(Box<State>),
    Progress(Progress),
    Arrivals(Arrivals),
    Pixel(Pixel),
    /// The connection is alive, which a page cannot see otherwise. A picture of so many bytes comes next; 0: none.
    Alive {
        bytes: usize,
    },
    Saved {
        files: Vec<String>,
    },
    /// The changes of [`Request::Set`] up to this number are in the newest state, or were refused.
    Answered {
        number: u32,
    },
    /// A request failed and changed nothing.
    Problem {
        message: String,
    },
    /// The render cannot go on with the present settings.
    Failed {
        message: String,
    },
}

impl Report {
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("a report is plain text and numbers")
    }
}

/// The scene and the program. It changes only if settings add or remove lights.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Welcome {
    pub version: String,
    pub scene: String,
    pub device: String,
    pub cameras: Vec<String>,
    pub emitters: Vec<Emitter>,
    pub estimators: Vec<&'static str>,
    /// Corners of the scene in metres.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Folder for saved images.
    pub folder: String,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Emitter {
    pub node: String,
    pub kind: String,
}

/// The present settings.
#[derive(Debug, Clone, Serialize)]
pub struct State {
    /// Counts the changes of settings, from 1.
    pub revision: u32,
    /// The settings that the user gave, as text, keyed by flag.
    pub settings: BTreeMap<String, String>,
    pub camera: Camera,
    pub responses: Vec<Response>,
    /// The nodes that emit.
    pub emitters: Vec<String>,
    pub estimator: &'static str,
    pub resolution: [u32; 2],
    pub max_depth: u32,
    pub sampling: &'static str,
    pub medium: Option<Medium>,
    pub paused: bool,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
    /// The `taugate render` command that makes the same image, without the number of samples and the output. None if flags cannot
    /// express these settings.
    pub command: Option<String>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Camera {
    pub name: String,
    pub look_from: [f64; 3],
    /// A point on the axis of the camera, at the distance of the scene's centre or a little further away.
    pub look_at: [f64; 3],
    pub up: [f64; 3],
    /// Vertical field of view in degrees; None for an orthographic camera.
    pub fov: Option<f64>,
    /// Height of an orthographic view in metres.
    pub ortho: Option<f64>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Response {
    pub name: String,
    /// Travel times in metres; `hi` is None in a steady image.
    pub lo: f64,
    pub hi: Option<f64>,
}

/// The last medium of the scene: its coefficients per metre, R, G, B.
#[derive(Debug, Clone, Serialize)]
pub struct Medium {
    pub sigma_s: [f64; 3],
    pub sigma_a: [f64; 3],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Phase {
    Preparing,
    /// The picture is smaller than the image.
    Coarse,
    Rendering,
    Paused,
    /// The budget that the viewer started with is used up.
    Done,
    /// No light can arrive inside the gate.
    Dark,
}

#[derive(Debug, Clone, Serialize)]
pub struct Progress {
    pub revision: u32,
    pub phase: Phase,
    pub samples: u64,
    pub min_samples: u64,
    pub max_samples: u64,
    pub iterations: u32,
    /// Time spent on these iterations.
    pub seconds: f64,
    pub rays_per_second: f64,
    /// Share of this time in which the device ran kernels; `None` if it has no timestamps.
    pub device_share: Option<f64>,
    /// Seconds of work of all host threads per second of this time.
    pub host_share: f64,
    pub relmse: Option<f64>,
}

/// A histogram of arriving light without a gate.
#[derive(Debug, Clone, Serialize)]
pub struct Arrivals {
    pub revision: u32,
    /// Range of travel times in metres.
    pub begin: f64,
    pub end: f64,
    /// Fractions of all light.
    pub light: Vec<f64>,
    /// Gates around percentiles of the arriving light, and the gate that the viewer started with.
    pub presets: Vec<Response>,
}

#[derive(Debug, Clone, Serialize)]
pub struct Pixel {
    pub x: u32,
    pub y: u32,
    /// Revision and response of the picture with these values, as in the header of a picture.
    pub revision: u32,
    pub response: u32,
    pub radiance: [f32; 3],
    /// Standard errors; None before two iterations, and with several responses.
    pub error: Option<[f32; 3]>,
    /// Number of samples of this pixel.
    pub samples: u64,
    /// Length of the camera ray in metres; None if the pixel shows no surface, or if it is not known yet.
    pub depth: Option<f32>,
    pub object: Option<String>,
    /// Luminance in each response; None with a single response, or with too many.
    pub histogram: Option<Vec<f32>>,
}
