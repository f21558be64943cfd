//! Writes the images of a render, or of its sums, to files.

use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::image::film::Film;
use taugate::internals::image::layers::Layers;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::image::{npy_file, png_file};
use taugate::internals::input::resolve::Outputs;
use taugate::internals::settings::exposure::Exposure;

use super::rescue::Rescue;

/// The images, and what is known about them.
pub struct Images<'a> {
    pub film: &'a Film,
    /// The images of several responses; `None` if there is one, whose image is the film.
    pub responses: Option<&'a ResponseFilm>,
    pub provenance: &'a Provenance,
    /// Auxiliary layers of the image file.
    pub layers: &'a Layers,
}

impl Images<'_> {
    /// Writes the image, the array and the picture. `rescue` handles the files that cannot be written.
    pub fn write(&self, outputs: &Outputs, rescue: &mut Rescue) {
        let Images { film, responses, provenance, layers } = *self;
        if let Some(path) = &outputs.exr {
            rescue.write(path, |path| exr_file::write_responses(path, film, responses, provenance, layers));
        }
        if let Some(path) = &outputs.npy {
            let stale = npy_file::stale_arrays(path);
            // The description comes first. An array without one would look like an array of another program.
            rescue.write(&npy_file::description_path(path), |path| {
                npy_file::write_description(path, film, responses, provenance)
            });
            if rescue.write(path, |path| npy_file::write_means(path, film, responses)) {
                rescue.check(npy_file::remove_stale(&stale));
            }
            if let Some((images, frequencies)) = responses.zip(provenance.responses.frequencies()) {
                rescue
                    .write(&npy_file::depth_path(path), |path| npy_file::write_depths(path, film, images, frequencies));
            }
            if outputs.variance {
                rescue.write(&npy_file::variance_path(path), |path| npy_file::write_variances(path, film, responses));
            }
        }
        if let Some(path) = &outputs.png {
            let exposure = self.exposure(outputs);
            rescue.write(path, |path| png_file::write(path, film.width(), film.height(), &film.mean(), exposure));
        }
    }

    /// The factor by which the picture multiplies linear values.
    pub fn exposure(&self, outputs: &Outputs) -> f32 {
        match outputs.exposure {
            Exposure::Auto => png_file::exposure(&self.film.mean()),
            Exposure::Stops(stops) => stops.exp2() as f32,
        }
    }

    /// How the picture was exposed, for a line of the summary; `None` without a picture.
    pub fn describe_exposure(&self, outputs: &Outputs) -> Option<String> {
        let png = outputs.png.as_ref()?;
        let stops = self.exposure(outputs).log2();
        let repeat = match outputs.exposure {
            Exposure::Auto => format!(" (auto; --exposure {stops:.2} gives other pictures the same)"),
            Exposure::Stops(_) => String::new(),
        };
        Some(format!("{}: exposure {stops:+.2} EV{repeat}", png.display()))
    }
}
