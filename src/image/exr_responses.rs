//! Reads the images of all responses from an EXR file that taugate wrote.

use std::path::Path;

use exr::meta::header::Header;
use exr::prelude::{AttributeValue, ReadChannels, ReadLayers, read as read_exr};
use serde::Deserialize;

use crate::error::{Error, Result};
use crate::image::exr_file::{read_picture, text};
use crate::image::exr_header::{header, unreadable};
use crate::image::npy_read::{DescribedResponse, ImageArray};

/// The name of the response of a file that lists none.
const SINGLE: &str = "gate";

/// A response in the attribute `tof:responses`. Infinity is null.
#[derive(Deserialize)]
struct Listed {
    name: String,
    gate_m: [Option<f64>; 2],
    weight_integral_m: Option<f64>,
    repeat_m: Option<f64>,
}

/// Whether the file holds the images of several responses.
pub fn has_many(path: &Path) -> Result<bool> {
    Ok(listed(path, &header(path, 3)?)?.is_some())
}

/// The images of all responses, and the responses if they are known. They are not known if another program wrote the file.
pub fn read(path: &Path) -> Result<(ImageArray, Option<Vec<DescribedResponse>>)> {
    let header = header(path, usize::MAX)?;
    let Some(responses) = listed(path, &header)? else {
        let picture = read_picture(path)?;
        let (width, height) = (picture.width as usize, picture.height as usize);
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let number = |name: &str| match header.own_attributes.other.get(&text(name)) {
            Some(AttributeValue::F64(number)) => finite(*number),
            _ => None,
        };
        let [weight_integral_m, repeat_m] = ["tof:weightIntegral_m", "tof:repeat_m"].map(number);
        let response = picture.gate.map(|[begin, end]| DescribedResponse {
            name: SINGLE.into(),
            gate_begin_m: begin,
            gate_end_m: finite(end),
            weight_integral_m,
            repeat_m,
        });
        let array = ImageArray { width, height, responses: None, values: picture.rgb };
        return Ok((array, response.map(|response| vec![response])));
    };
    let layer = read_exr()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(|e| unreadable(path, e))?
        .layer_data;
    let (width, height, count) = (layer.size.width(), layer.size.height(), responses.len());
    let mut values = vec![0.0; 3 * width * height * count];
    for (k, response) in responses.iter().enumerate() {
        for (c, letter) in ["R", "G", "B"].into_iter().enumerate() {
            let name = if k == 0 { letter.into() } else { format!("{}.{letter}", response.name) };
            let channel = layer.channel_data.list.iter().find(|channel| channel.name == text(&name));
            let channel = channel.ok_or_else(|| Error::File {
                path: path.into(),
                message: format!("lacks the channel {name} of one of its gates; render it again"),
            })?;
            let of_response = values.iter_mut().skip(3 * k + c).step_by(3 * count);
            of_response.zip(channel.sample_data.values_as_f32()).for_each(|(value, x)| *value = x);
        }
    }
    Ok((ImageArray { width, height, responses: Some(count), values }, Some(responses)))
}

/// The responses in the attribute `tof:responses`; `None` without it.
fn listed(path: &Path, header: &Header) -> Result<Option<Vec<DescribedResponse>>> {
    let Some(AttributeValue::Text(list)) = header.own_attributes.other.get(&text("tof:responses")) else {
        return Ok(None);
    };
    let of = |Listed { name, gate_m: [begin, end], weight_integral_m, repeat_m }| DescribedResponse {
        name,
        gate_begin_m: begin.unwrap_or(0.0),
        gate_end_m: end,
        weight_integral_m,
        repeat_m,
    };
    match serde_json::from_slice::<Vec<Listed>>(list.bytes()) {
        // Each response has three channels of its own.
        Ok(all) if !all.is_empty() && 3 * all.len() <= header.channels.list.len() => {
            Ok(Some(all.into_iter().map(of).collect()))
        }
        _ => Err(Error::File {
            path: path.into(),
            message: "has a list of gates (tof:responses) that cannot be read; render it again".into(),
        }),
    }
}
