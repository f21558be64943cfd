//! The native part of taugate for Python. `taugate/` wraps it; users import only that.

mod arrays;
mod camera;
mod detect;
mod engine;
mod errors;
mod flags;
mod image;
mod resume;
mod scan;
mod scene;
mod state;
mod sums;

use pyo3::prelude::*;

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("VERSION", taugate::internals::image::exr_file::version())?;
    module.add_class::<scene::NativeScene>()?;
    module.add_class::<image::Image>()?;
    module.add_class::<camera::View>()?;
    module.add_function(wrap_pyfunction!(scan::scan, module)?)?;
    module.add_function(wrap_pyfunction!(detect::detect, module)?)?;
    module.add_function(wrap_pyfunction!(scan::write_scan, module)?)?;
    module.add_function(wrap_pyfunction!(scan::check_scan, module)?)?;
    module.add_class::<sums::Sums>()?;
    module.add_function(wrap_pyfunction!(sums::check_parts, module)?)?;
    module.add_function(wrap_pyfunction!(sums::accumulate, module)?)?;
    module.add_function(wrap_pyfunction!(sums::image_of_sums, module)?)?;
    module.add_function(wrap_pyfunction!(sums::refuse_black, module)?)?;
    module.add_function(wrap_pyfunction!(sums::seconds, module)?)?;
    module.add_function(wrap_pyfunction!(sums::part, module)?)?;
    module.add_function(wrap_pyfunction!(sums::samples_before_iteration, module)?)?;
    module.add_function(wrap_pyfunction!(flags::reason_of_missing, module)?)?;
    module.add_function(wrap_pyfunction!(flags::flags, module)?)
}
