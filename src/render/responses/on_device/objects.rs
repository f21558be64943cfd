//! The kernels and buffers of images on the device.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::{Allocate, Buffer, BufferDesc, Device, Kernel, Recorder};
use crate::image::response_film::ResponseFilm;
use crate::render::sensor::MIN_GROUP_LIMIT;
use crate::wgsl::layout::{Dispatch, SensorContribution};

/// File and entry points of the kernels.
pub const ENTRIES: [(&str, &str); 6] = [
    ("add_arrivals", "add_arrivals"),
    ("add_arrivals", "add_splats"),
    ("sum_responses", "total_responses"),
    ("sum_responses", "add_responses"),
    ("sum_responses", "clear_present"),
    ("sum_responses", "clear_sums"),
];

/// Kernels and buffers.
pub struct Objects {
    pub kernels: Kernels,
    pub buffers: Buffers,
    /// The splats of an iteration; it grows.
    pub splats: Buffer,
    pub recorder: Recorder,
}

pub struct Kernels {
    pub arrivals: Arc<Kernel>,
    pub splats: Kernel,
    pub total: Kernel,
    pub add: Kernel,
    pub clear_present: Kernel,
    pub clear_sums: Kernel,
}

pub struct Buffers<A: Allocate = Device> {
    pub gates: A::Buffer,
    pub present: A::Buffer,
    pub sums: A::Buffer,
    pub squares: A::Buffer,
    pub total: A::ReadBack,
}

impl<A: Allocate> Buffers<A> {
    pub fn new(to: &A, pixels: usize, gates: usize, has_variance: bool) -> Result<Buffers<A>> {
        let remedy = "use a smaller --resolution or fewer gates";
        let values = 3 * pixels * gates;
        let of_images = |name, count| BufferDesc::of::<f64>(name, count, remedy);
        Ok(Buffers {
            gates: to.buffer(BufferDesc::of::<[f32; 2]>("gates", gates, remedy))?,
            present: to.buffer(of_images("images of an iteration", values))?,
            sums: to.buffer(of_images("images of gates", values))?,
            squares: to.buffer(of_images("squares of gates", if has_variance { values } else { 0 }))?,
            total: to.read_back(BufferDesc::of::<f32>("sums over gates", 3 * pixels, remedy))?,
        })
    }
}

impl Objects {
    /// Objects whose images are those of `film`.
    pub fn new(
        device: &Device,
        constants: &[(&'static str, f64)],
        gates: &[[f32; 2]],
        film: &ResponseFilm,
    ) -> Result<Objects> {
        let [arrivals, splats, total, add, clear_present, clear_sums] =
            ENTRIES.map(|(file, entry)| Kernel::new(device, file, entry, constants));
        let kernels = Kernels {
            arrivals: arrivals?.into(),
            splats: splats?,
            total: total?,
            add: add?,
            clear_present: clear_present?,
            clear_sums: clear_sums?,
        };
        let mut buffers: Buffers = Buffers::new(device, film.pixels(), gates.len(), film.has_variance())?;
        buffers.gates.write(0, gates)?;
        let splats = Buffer::new::<SensorContribution>(device, "splats", 1, "use fewer --splat-paths")?;
        let mut objects = Objects { kernels, buffers, splats, recorder: Recorder::new(device)? };
        let [sums, squares] = film.sums();
        if film.length().1 > 0 {
            objects.buffers.sums.write(0, sums)?;
            objects.buffers.squares.write(0, squares)?;
        } else {
            objects.clear(sums.len(), film.has_variance())?;
        }
        Ok(objects)
    }

    /// Clears the images, of so many values.
    pub fn clear(&mut self, values: usize, has_variance: bool) -> Result<()> {
        let all = Dispatch { count: values as u32, counter: has_variance.into(), ..bytemuck::Zeroable::zeroed() };
        dispatch_over(&mut self.recorder, &self.kernels.clear_sums, &self.buffers, all)?;
        self.recorder.submit().map(drop)
    }
}

impl Buffers {
    pub fn bindings(&self) -> [(&str, &Buffer); 5] {
        [
            ("gates", &self.gates),
            ("present", &self.present),
            ("sums", &self.sums),
            ("squares", &self.squares),
            ("total", self.total.buffer()),
        ]
    }
}

/// Records a kernel whose threads take turns until all `constants.count` values are done.
pub fn dispatch_over(recorder: &mut Recorder, kernel: &Kernel, buffers: &Buffers, constants: Dispatch) -> Result<()> {
    let bound = kernel.bind(&buffers.bindings())?;
    let groups = kernel.groups(constants.count as usize).min(MIN_GROUP_LIMIT);
    recorder.dispatch("add_responses", kernel, &bound, &constants, groups)
}
