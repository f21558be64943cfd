//! A file that leads a browser to the page. Its name may be seen by all users of the machine, in the arguments of the command that
//! starts the browser. The address of the page may not, since it contains the token.

use std::io::{Result, Write};
use std::path::Path;

use tempfile::TempPath;

/// An HTML file that only this user can read. Dropping it removes the file.
pub struct Signpost(TempPath);

impl Signpost {
    /// Writes a file that leads to `url`, which has no characters with a meaning in HTML.
    pub fn to(url: &str) -> Result<Signpost> {
        let mut file = tempfile::Builder::new().prefix("taugate-").suffix(".html").tempfile()?;
        write!(
            file,
            "<!doctype html>\n<meta charset=\"utf-8\">\n<meta http-equiv=\"refresh\" content=\"0; url={url}\">\n\
             <title>taugate</title>\n<p><a href=\"{url}\">The page of taugate</a>\n"
        )?;
        Ok(Signpost(file.into_temp_path()))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}
