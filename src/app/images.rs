//! Writes the images of a render, or of its sums, to files.

use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::image::film::Film;
use taugate::internals::image::layers::Layers;
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::image::{npy_file, png_file};
use taugate::internals::input::resolve::Outputs;
use taugate::internals::settings::GatePictures;
use taugate::internals::settings::exposure::Exposure;

use super::rescue::Rescue;
use super::sheet::{Linear, sheet};

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
            rescue.write(path, |path| npy_file::write(path, film, responses, provenance, outputs.variance));
        }
        let exposure = self.exposure(outputs);
        let several = responses.filter(|_| outputs.png_gates != GatePictures::Sum);
        for (k, path) in outputs.pictures().iter().enumerate() {
            let picture = match several {
                None => self.sum(),
                Some(all) if outputs.png_gates == GatePictures::Each => self.gate(all, k),
                Some(all) => match sheet(all.responses(), |k| Ok(self.gate(all, k))) {
                    Ok(sheet) => sheet,
                    Err(_) => unreachable!("the images are in memory"),
                },
            };
            let Linear { width, height, rgb } = picture;
            rescue.write(path, |path| png_file::write(path, width as u32, height as u32, &rgb, exposure));
        }
    }

    /// The image of all light.
    fn sum(&self) -> Linear {
        Linear { width: self.film.width() as usize, height: self.film.height() as usize, rgb: self.film.shown() }
    }

    /// The image of gate `k`.
    fn gate(&self, all: &ResponseFilm, k: usize) -> Linear {
        let rgb = (0..all.pixels()).flat_map(|pixel| all.means_of(pixel).skip(3 * k).take(3)).collect();
        Linear { rgb, ..self.sum() }
    }

    /// The factor by which the picture multiplies linear values.
    pub fn exposure(&self, outputs: &Outputs) -> f32 {
        match outputs.exposure {
            Exposure::Auto => match self.responses.filter(|_| outputs.png_gates != GatePictures::Sum) {
                None => png_file::exposure(&self.film.shown()),
                // All gates have one exposure.
                Some(all) => {
                    let see_all = |see: &mut dyn FnMut(&[f32])| {
                        (0..all.responses()).for_each(|k| see(&self.gate(all, k).rgb));
                        Ok(())
                    };
                    png_file::common_exposure(see_all).unwrap_or(1.0)
                }
            },
            Exposure::Stops(stops) => stops.exp2() as f32,
        }
    }

    /// How the picture was exposed, for a line of the summary; `None` without a picture.
    pub fn describe_exposure(&self, outputs: &Outputs) -> Option<String> {
        let pictures = outputs.pictures();
        let png = pictures.first()?;
        let stops = self.exposure(outputs).log2();
        let repeat = match outputs.exposure {
            Exposure::Auto => format!(" (auto; --exposure {stops:.2} gives other pictures the same)"),
            Exposure::Stops(_) => String::new(),
        };
        Some(format!("{}: exposure {stops:+.2} EV{repeat}", png.display()))
    }
}
