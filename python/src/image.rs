//! The result of a render: arrays for NumPy, and the files of the command line.

use std::path::{Path, PathBuf};

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use serde::{Deserialize, Serialize};
use taugate::internals::image::accumulation::{self, About, Accumulation};
use taugate::internals::image::exr_file::{self, Provenance};
use taugate::internals::image::film::Film;
use taugate::internals::image::layers::{Layers, Plane};
use taugate::internals::image::response_film::ResponseFilm;
use taugate::internals::image::{depth, npy_file, png_file};
use taugate::internals::settings::{Crop, Responses};

use crate::camera::View;
use crate::engine::check_process;
use crate::errors::{Result, settings, shown};
use crate::sums::{bytes, read};

/// A finished or interrupted render.
#[pyclass(frozen, name = "NativeImage", module = "taugate._native")]
pub struct Image {
    /// The images and their description. The description has no fingerprint of the scene, unless the sums come from `taugate.farm`.
    pub sums: Accumulation,
    pub responses: Responses,
    pub layers: Layers,
    pub view: View,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
    pub dropped: u64,
}

/// The rest of a pickle besides the sums and the planes of the layers, as TOML.
#[derive(Serialize, Deserialize)]
struct Rest {
    notes: Vec<String>,
    warnings: Vec<String>,
    dropped: u64,
    objects: Vec<(u32, String)>,
    view: View,
    responses: Responses,
}

impl Image {
    fn film(&self) -> &Film {
        &self.sums.film
    }

    /// `None` if there is one response, whose image is the film.
    fn images(&self) -> Option<&ResponseFilm> {
        self.sums.responses.as_ref()
    }

    fn provenance(&self) -> Provenance {
        let About { resolution, crop: [x0, x1, y0, y1], seed, seconds, settings, .. } = self.sums.about.clone();
        let crop = Crop { x0, y0, x1, y1 };
        Provenance {
            resolution,
            crop,
            responses: self.responses.clone(),
            seed,
            seconds,
            settings,
            merged: self.sums.merged(),
        }
    }

    fn shape(&self) -> [usize; 3] {
        [self.film().height() as usize, self.film().width() as usize, 3]
    }

    fn write(&self, path: &Path, exposure: Option<f32>) -> Result<()> {
        check_process()?;
        let (film, responses, provenance) = (self.film(), self.images(), &self.provenance());
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "exr" => exr_file::write_responses(path, film, responses, provenance, &self.layers)?,
            "png" => {
                let mean = film.shown();
                let factor = exposure.map_or_else(|| png_file::exposure(&mean), f32::exp2);
                png_file::write(path, film.width(), film.height(), &mean, factor)?;
            }
            "npy" => {
                let has_variance = responses.is_none_or(ResponseFilm::has_variance);
                npy_file::write(path, film, responses, provenance, has_variance)?;
            }
            "acc" if self.sums.about.scene.is_empty() => {
                return Err(settings(
                    "only images of taugate.farm can be saved as sums (.acc); other renders write them with checkpoint='OUT.acc'",
                ));
            }
            "acc" => accumulation::file::write(path, self.sums.parts())?,
            _ => return Err(settings(format!("the output {} must end in .exr, .npy, .png or .acc", path.display()))),
        }
        Ok(())
    }
}

type Array<'py> = Bound<'py, PyAny>;

/// An array of this shape.
pub fn array<'py, T: numpy::Element>(py: Python<'py>, values: Vec<T>, shape: &[usize]) -> PyResult<Array<'py>> {
    Ok(PyArray1::from_vec(py, values).reshape(shape.to_vec())?.into_any())
}

#[pymethods]
impl Image {
    /// The same image, because nothing can change it.
    fn __deepcopy__<'py>(slf: &Bound<'py, Self>, _memo: &Bound<'py, PyAny>) -> Bound<'py, Self> {
        slf.clone()
    }

    /// The function that makes an equal image, and its arguments: see `restored`.
    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Array<'py>, (Bound<'py, PyBytes>, Bound<'py, PyDict>, String))> {
        let sums = py.detach(|| bytes(self.sums.parts()))?;
        let planes = PyDict::new(py);
        for (name, plane) in &self.layers.channels {
            let plane = match plane {
                Plane::Floats(values) => PyArray1::from_slice(py, values).into_any(),
                Plane::Ids(ids) => PyArray1::from_slice(py, ids).into_any(),
            };
            planes.set_item(name, plane)?;
        }
        let rest = Rest {
            notes: self.notes.clone(),
            warnings: self.warnings.clone(),
            dropped: self.dropped,
            objects: self.layers.objects.clone().into_iter().collect(),
            view: self.view.clone(),
            responses: self.responses.clone(),
        };
        let rest =
            toml::to_string(&rest).map_err(|e| PyErr::from(settings(format!("the image cannot be pickled: {e}"))))?;
        Ok((py.get_type::<Image>().getattr("restored")?, (PyBytes::new(py, &sums), planes, rest)))
    }

    /// The image of a pickle: the bytes of a file `.acc`, the layers by the names of their channels, and the rest as TOML.
    #[staticmethod]
    fn restored(py: Python<'_>, sums: &[u8], planes: &Bound<'_, PyDict>, rest: &str) -> PyResult<Image> {
        let sums = py.detach(|| read(sums))?;
        let rest = toml::from_str(rest).map_err(|e| PyErr::from(settings(format!("this is no pickled image: {e}"))))?;
        let Rest { notes, warnings, dropped, objects, view, responses } = rest;
        let mut layers = Layers { objects: objects.into_iter().collect(), ..Layers::default() };
        for (name, plane) in planes {
            let plane = match plane.extract::<PyReadonlyArray1<'_, f32>>() {
                Ok(values) => Plane::Floats(values.as_slice()?.to_vec()),
                Err(_) => Plane::Ids(plane.extract::<PyReadonlyArray1<'_, u32>>()?.as_slice()?.to_vec()),
            };
            layers.channels.push((name.extract()?, plane));
        }
        Ok(Image { sums, responses, layers, view, notes, warnings, dropped })
    }

    /// The image, or the sum of the images of all responses: (H, W, 3).
    fn pixels<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        check_process()?;
        array(py, self.film().shown(), &self.shape())
    }

    /// The image without damping; `None` if fireflies are kept.
    fn undamped<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        check_process()?;
        let film = self.film();
        film.damps_fireflies().then(|| array(py, film.mean(), &self.shape())).transpose()
    }

    /// Variance of `pixels`, or of `undamped` if fireflies are damped.
    fn variance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        check_process()?;
        array(py, self.film().variance_of_mean(), &self.shape())
    }

    /// The images of all responses: (H, W, T, 3).
    fn bins<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        check_process()?;
        let [height, width, _] = self.shape();
        match self.images() {
            None => array(py, self.film().shown(), &[height, width, 1, 3]),
            Some(all) => {
                let values: Vec<f32> = (0..all.pixels()).flat_map(|pixel| all.means_of(pixel)).collect();
                array(py, values, &[height, width, all.responses(), 3])
            }
        }
    }

    /// Variance of `bins`; `None` if it was not estimated.
    fn bin_variance<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        check_process()?;
        let [height, width, _] = self.shape();
        match self.images() {
            None => array(py, self.film().variance_of_mean(), &[height, width, 1, 3]).map(Some),
            Some(all) if !all.has_variance() => Ok(None),
            Some(all) => {
                let values: Vec<f32> = (0..all.pixels()).flat_map(|pixel| all.variances_of(pixel)).collect();
                array(py, values, &[height, width, all.responses(), 3]).map(Some)
            }
        }
    }

    /// Layers by the names of their channels, each (H, W): auxiliary layers, and those of a continuous-wave sensor.
    fn layers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let shape = &self.shape()[..2];
        let dict = PyDict::new(py);
        for (name, plane) in &self.layers.channels {
            let layer = match plane {
                Plane::Floats(values) => array(py, values.clone(), shape)?,
                Plane::Ids(ids) => array(py, ids.clone(), shape)?,
            };
            dict.set_item(name, layer)?;
        }
        if let Some(images) = self.images() {
            for (name, values) in depth::planes(images, &self.responses) {
                dict.set_item(name, array(py, values, shape)?)?;
            }
        }
        Ok(dict)
    }

    /// Names of the objects in the layer `object.ID`.
    fn objects<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        self.layers.objects.iter().try_for_each(|(id, name)| dict.set_item(id, name))?;
        Ok(dict)
    }

    /// Name, begin and end of each response, in metres of optical path.
    #[getter]
    fn gates(&self) -> Vec<(String, f64, f64)> {
        let responses = self.responses.iter();
        responses.map(|response| (response.name().into(), response.gate().lo, response.gate().hi)).collect()
    }

    /// Begin, width and number of the gates, if all have the same width and abut.
    #[getter]
    fn uniform(&self) -> Option<(f64, f64, u32)> {
        self.responses.uniform().map(|gates| (gates.whole().lo, gates.width(), gates.count()))
    }

    /// The support of all responses, as the command line takes it.
    #[getter]
    fn support(&self) -> String {
        self.responses.support().to_string()
    }

    #[getter]
    fn samples(&self) -> u64 {
        self.film().samples()
    }

    #[getter]
    fn iterations(&self) -> u32 {
        self.film().iterations()
    }

    #[getter]
    fn dropped(&self) -> u64 {
        self.dropped
    }

    #[getter]
    fn seconds(&self) -> f64 {
        self.sums.about.seconds
    }

    #[getter]
    fn settings(&self) -> &str {
        &self.sums.about.settings
    }

    #[getter]
    fn view(&self) -> View {
        self.view.clone()
    }

    #[getter]
    fn notes(&self) -> Vec<String> {
        shown(&self.notes)
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        shown(&self.warnings)
    }

    /// Mean over all pixels and channels, and its standard error.
    #[getter]
    fn mean(&self) -> (f64, Option<f64>) {
        self.film().image_mean()
    }

    /// The JSON that `save` writes beside an array.
    fn description(&self) -> PyResult<String> {
        let provenance = self.provenance();
        let description = npy_file::description(self.film(), self.images(), &provenance);
        serde_json::to_string(&description).map_err(|e| settings(format!("the image cannot be described: {e}")).into())
    }

    /// Writes a file, and the files that the command line writes beside it. `exposure` in stops is for pictures.
    #[pyo3(signature = (path, exposure=None))]
    fn save(&self, py: Python<'_>, path: PathBuf, exposure: Option<f32>) -> PyResult<()> {
        Ok(py.detach(|| self.write(&path, exposure))?)
    }

    /// The image as sRGB bytes, (H, W, 3), with the exposure of a PNG file.
    #[pyo3(signature = (exposure=None))]
    fn picture<'py>(&self, py: Python<'py>, exposure: Option<f32>) -> PyResult<Array<'py>> {
        check_process()?;
        let mean = self.film().shown();
        let factor = exposure.map_or_else(|| png_file::exposure(&mean), f32::exp2);
        array(py, png_file::expose(&mean, factor), &self.shape())
    }
}
