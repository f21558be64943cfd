//! The settings of the scene: its camera, its emitters, and how it is read.

use std::path::PathBuf;

use crate::settings::lens::{ApertureDiameter, Focus, LensDistortion, VignettingChoice};
use crate::settings::moment::Moment;
use crate::settings::numbers::{Fov, Headlamp, Height, Lamps, Numbers};
use crate::settings::setting::Taker::{Info, Page, View};
use crate::settings::setting::{Form, Setting, table};
use crate::settings::shutter::{LineTime, Shutter};
use crate::settings::sky::{Sky, SkyScale};
use crate::settings::values::{Folders, Resolution};
use crate::settings::{Crop, Emitters, ThinGlass};

table! {
    /// `[camera]`: the camera and the image size. At most one of `fov` and `ortho`.
    CameraTable = "camera" {
        /// Name of the camera in the scene; NAME#2 is the second camera of this name; auto: a view of the whole scene, slightly
        /// from above [default: the first camera, or auto if there is none]
        camera: String, Setting::scene("camera", "NAME|auto").also(Page).resets(&["look-from", "look-at", "up", "fov", "ortho", "principal-point", "camera-matrix", "distortion", "calibration", "aperture", "focus", "blades", "vignetting"]);

        /// Place of the camera in metres, instead of its own; without --look-at the camera looks at the centre of the scene
        look_from: Numbers<3>, Setting::scene("look-from", "X,Y,Z").form(Form::Signed).also(Page);

        /// Point at which the camera looks, in metres
        look_at: Numbers<3>, Setting::scene("look-at", "X,Y,Z").form(Form::Signed).also(Page);

        /// Direction that is upwards in the image [default with --look-from or --look-at: 0,1,0]
        up: Numbers<3>, Setting::scene("up", "X,Y,Z").form(Form::Signed).also(Page);

        /// Vertical field of view of a perspective camera in degrees [default: that of the camera, else 40]
        fov: Fov, Setting::scene("fov", "DEGREES").also(Page);

        /// Orthographic view of this height in metres: parallel camera rays, which start on a plane through the camera
        ortho: Height, Setting::scene("ortho", "HEIGHT").excludes(&["fov"], "set the view of the camera").also(Page);

        /// Where the axis of the camera meets the image, as fractions of its width and height from the top left corner [default:
        /// that of the camera, else 0.5,0.5]
        principal_point: Numbers<2>, Setting::scene("principal-point", "X,Y").form(Form::Signed);

        /// Intrinsic matrix of a calibrated camera in pixels: focal lengths and principal point; the centre of the first pixel is 0,0, as
        /// in OpenCV
        camera_matrix: Numbers<4>, Setting::scene("camera-matrix", "FX,FY,CX,CY").form(Form::Signed).excludes(&["fov", "ortho", "principal-point"], "set the view of the camera");

        /// Lens distortion with the coefficients of OpenCV: k1,k2,p1,p2, then k3, then k4,k5,k6 if there are any; or
        /// fisheye:k1,k2,k3,k4
        distortion: LensDistortion, Setting::scene("distortion", "K1,K2,P1,P2,...").form(Form::Signed).excludes(&["ortho"], "set the view of the camera");

        /// Read --camera-matrix, --distortion and --resolution from the calibration file of a camera, as OpenCV, ROS and Kalibr write
        /// it (.yml, .yaml, .json)
        calibration: PathBuf, Setting::scene("calibration", "FILE").excludes(&["camera-matrix", "distortion", "fov", "ortho", "principal-point"], "set the view of the camera");

        /// Aperture of the lens, as a diameter like 8mm, or as f-number and focal length like f/2.8@35mm; only points at --focus are
        /// sharp [default: a pinhole]
        aperture: ApertureDiameter, Setting::scene("aperture", "DIAMETER|f/N@LENGTH").excludes(&["ortho"], "set the view of the camera").also(Page);

        /// Distance in metres at which --aperture is in focus, along the view of the camera, or inf
        focus: Focus, Setting::scene("focus", "DISTANCE").excludes(&["ortho"], "set the view of the camera").also(Page);

        /// Number of blades of --aperture, which is then a regular polygon [default: 0, a disc]
        blades: u32, Setting::scene("blades", "N").excludes(&["ortho"], "set the view of the camera").also(Page);

        /// Share of the light that reaches the sensor, by the angle to the view: cos4, the fourth power of its cosine; or a table
        /// of angles in degrees and shares [default: all light]
        vignetting: VignettingChoice, Setting::scene("vignetting", "cos4|FILE.csv").excludes(&["ortho"], "set the view of the camera");

        /// Image size in pixels [default: the resolution of the camera, else 512 pixels wide]
        resolution: Resolution, Setting::scene("resolution", "WxH").also(Page);

        /// Render only the pixels x0 <= x < x1, y0 <= y < y1; they have the same values as in the whole image (with --sampling
        /// adaptive, the same except for noise)
        crop: Crop, Setting::scene("crop", "x0,x1,y0,y1").except(View);
    }
}

table! {
    /// `[emitter]`: the emitters that are switched on, and lights to add.
    EmitterTable = "emitter" {
        /// Emitters that are switched on: scene for all, or names of nodes; may be repeated [default: scene]
        emitters: Emitters, Setting::scene("emitters", "scene|NODE,...").form(Form::Repeated).also(Page);

        /// Add a point light at the camera, called headlamp, with this intensity; without a number, a white surface that faces
        /// it at the distance of the scene's centre has radiance 1 [default: only if the scene has no light]
        headlamp: Headlamp, Setting::scene("headlamp", "W/sr").form(Form::Optional { bare: "auto", equals: false }).also(Page);

        /// Place of the headlamp, in metres to the right, upwards and backwards from the camera; switches the headlamp on
        /// [default: 0,0,0]
        headlamp_offset: Numbers<3>, Setting::scene("headlamp-offset", "X,Y,Z").form(Form::Signed).also(Page);

        /// Add a point light at X,Y,Z (metres) with this intensity in W/sr, called lamp-1, lamp-2, ...; may be repeated
        lamp: Lamps, Setting::scene("lamp", "X,Y,Z,INTENSITY").form(Form::SignedRepeated);

        /// Add light from all directions, called sky: its radiance in W/(m^2 sr), as one number or R,G,B, or the file of an
        /// equirectangular image (.exr, .hdr) with +Y up; gated renders leave it out, because it has no travel time
        sky: Sky, Setting::scene("sky", "RADIANCE|FILE.exr").form(Form::Signed);

        /// Factor on the radiance of --sky [default: 1]
        sky_scale: SkyScale, Setting::scene("sky-scale", "FACTOR").form(Form::Signed);
    }
}

table! {
    /// `[input]`: how the scene is read.
    InputTable = "input" {
        /// All surfaces reflect and emit on both sides; without this flag the back of a surface is black, unless the scene marks it
        /// as double-sided
        double_sided: bool, Setting::scene("double-sided", "").form(Form::Switch).also(Page);

        /// Glass that is thin: light passes straight on, as through a window that is modelled as one plane; other glass is solid and
        /// refracts light. auto: glass of open meshes, and glass whose material has extras.thin = true [default: auto]
        thin_glass: ThinGlass, Setting::scene("thin-glass", "auto|all|none");

        /// Also read files of a .gltf scene that lie in this folder or below, such as ../textures; other files must lie in the folder
        /// of the scene or below; may be repeated
        allow_path: Folders, Setting::scene("allow-path", "DIR").form(Form::Repeated).affects_no_image();

        /// Play the animations of the scene up to this time in seconds, from 0 on, such as 1.5s; without it, nodes keep the transforms
        /// in the file
        at: Moment, Setting::scene("at", "TIME").form(Form::Signed);

        /// When the shutter is open, in time of the animations after --at or after the frame's time, such as 0..20ms; what moves
        /// meanwhile is blurred [default: for an instant]
        shutter: Shutter, Setting::scene("shutter", "A..B").form(Form::Signed).except(View).except(Info);

        /// Rolling shutter: each row of the image is exposed later than the row above by this time, such as 20us [default: all rows
        /// at once]
        rolling: LineTime, Setting::scene("rolling", "TIME").except(View).except(Info);

        /// Name of the animation to play; NAME#2 is the second animation of this name; none: no animation [default: all of them
        /// together]
        animation: String, Setting::scene("animation", "NAME");
    }
}

impl InputTable {
    /// The folders of `allow-path`; empty if the user gave none.
    pub fn allowed(&self) -> Vec<PathBuf> {
        self.allow_path.clone().map_or(vec![], |folders| folders.0)
    }

    /// The time of the pose in seconds: with a shutter the middle of its exposure, of the first row. `None`: that of the file.
    pub fn moment(&self) -> Option<f64> {
        let at = self.at.map(|Moment(at)| at);
        self.shutter.map_or(at, |shutter| Some((at.unwrap_or(0.0) + shutter.middle()).max(0.0)))
    }
}
