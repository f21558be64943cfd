//! The channels of a render: the same names and values in image files and in viewers.

use crate::image::depth;
use crate::image::film::Film;
use crate::image::response_film::ResponseFilm;
use crate::settings::Responses;
use crate::settings::doppler::Doppler;

/// Channels of one image whose values are interleaved.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelGroup {
    /// Names of the channels, such as `R`, `G` and `B`.
    pub names: Vec<String>,
    /// The values, pixel by pixel and row by row, row 0 at the top. Each pixel has one value per name.
    pub values: Vec<f32>,
}

impl ChannelGroup {
    /// R, G and B, with `prefix` before their names.
    pub fn rgb(prefix: &str, values: Vec<f32>) -> ChannelGroup {
        ChannelGroup { names: ["R", "G", "B"].map(|name| format!("{prefix}{name}")).into(), values }
    }

    /// One channel.
    pub fn single(name: String, values: Vec<f32>) -> ChannelGroup {
        ChannelGroup { names: vec![name], values }
    }

    /// The names, each with the values of its channel.
    pub fn into_channels(self) -> impl Iterator<Item = (String, Vec<f32>)> {
        let ChannelGroup { names, values } = self;
        let count = names.len();
        names
            .into_iter()
            .enumerate()
            .map(move |(k, name)| (name, values.iter().skip(k).step_by(count).copied().collect()))
    }
}

/// The channels of the first `max_responses` responses. R, G, B and their variance, Variance.R, .G, .B, are those of the first
/// response. A further response NAME has the channels NAME.R and, with a variance, NAME.Variance.R, and so on. A continuous-wave
/// sensor has phases, amplitudes and depths too. If fireflies are damped, R, G, B are the damped image, and undamped.R, .G, .B the mean,
/// to which the variance belongs. If the image records velocities, whose colours saturate at `doppler` in m/s, each response has the
/// channels velocity.mean and velocity.deviation in m/s, see [`Doppler::decode`]. `images` is `None` if there is one response, whose image is the film.
pub fn of_render(
    film: &Film,
    images: Option<&ResponseFilm>,
    responses: &Responses,
    max_responses: usize,
    doppler: Option<f64>,
) -> Vec<ChannelGroup> {
    let Some(images) = images else {
        let variance = ChannelGroup::rgb("Variance.", film.variance_of_mean());
        let mean = film.mean();
        let velocity = doppler.map(|speed| velocity("", &mean, speed));
        let mut groups = match film.damped() {
            None => vec![ChannelGroup::rgb("", mean), variance],
            Some(damped) => vec![ChannelGroup::rgb("", damped.rgb), ChannelGroup::rgb("undamped.", mean), variance],
        };
        groups.extend(velocity);
        return groups;
    };
    let mut groups = vec![];
    for (k, response) in responses.iter().enumerate().take(max_responses) {
        let prefix = if k == 0 { String::new() } else { format!("{}.", response.name()) };
        let mean = images.mean(k);
        groups.extend(doppler.map(|speed| velocity(&prefix, &mean, speed)));
        groups.push(ChannelGroup::rgb(&prefix, mean));
        if images.has_variance() {
            groups.push(ChannelGroup::rgb(&format!("{prefix}Variance."), images.variance_of_mean(k)));
        }
    }
    let planes = depth::planes(images, responses).into_iter();
    groups.extend(planes.map(|(name, values)| ChannelGroup::single(name, values)));
    groups
}

/// Mean and deviation of the velocities of an image with interleaved R, G and B whose colours saturate at `speed` in m/s.
fn velocity(prefix: &str, rgb: &[f32], speed: f64) -> ChannelGroup {
    let decode = |pixel: &[f32; 3]| Doppler::decode(speed, pixel.map(f64::from)).map(|x| x as f32);
    let (pixels, _) = rgb.as_chunks::<3>();
    let names = ["mean", "deviation"].map(|name| format!("{prefix}velocity.{name}")).into();
    ChannelGroup { names, values: pixels.iter().flat_map(decode).collect() }
}
