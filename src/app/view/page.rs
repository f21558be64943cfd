//! The files of the page, embedded in the program.

/// MIME type and text of a file of the page; `None` if there is no such file.
pub fn file(name: &str) -> Option<(&'static str, &'static str)> {
    let (_, text) = FILES.into_iter().find(|(known, _)| *known == name)?;
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "text/plain; charset=utf-8",
    };
    Some((kind, text))
}

macro_rules! files {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("page/", $name)))),*] };
}

const FILES: [(&str, &str); 28] = files![
    "index.html",
    "camera.js",
    "colours.js",
    "compare.js",
    "display.js",
    "dom.js",
    "frame.js",
    "gate.js",
    "icon.svg",
    "link.js",
    "main.js",
    "medium.js",
    "messages.js",
    "panel.js",
    "picture.js",
    "picture_2d.js",
    "picture_gl.js",
    "play.js",
    "plot.js",
    "readout.js",
    "save.js",
    "steer.js",
    "style.css",
    "timeline.js",
    "tools.js",
    "units.js",
    "view.js",
    "work.js",
];
