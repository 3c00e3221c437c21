//! How the viewer arranges what it is given: space beside the image, figures below.
//!
//! The viewer keeps its arrangement as data of its own, a tree of containers and views with numbers for names.

use re_sdk::external::re_log_types::BlueprintActivationCommand;
use re_sdk::{AsComponents, RecordingStream, RecordingStreamBuilder, RecordingStreamError};
use re_types::blueprint::archetypes::{ContainerBlueprint, EyeControls3D, PlotLegend, ViewBlueprint, ViewContents, ViewportBlueprint};
use re_types::blueprint::components::ContainerKind;
use re_types::datatypes::Uuid;

use super::sink::Sink;

/// A part of the window with what it takes of the room beside its neighbours.
enum Part {
    View { kind: Kind, name: &'static str, origin: &'static str },
    Container { kind: ContainerKind, parts: Vec<(Part, f32)> },
}

/// What a view shows.
#[derive(Clone, Copy)]
enum Kind {
    Space,
    Image,
    Figures,
    /// Without a legend, which would hide most of them.
    ManyFigures,
    Text,
}

impl Kind {
    fn class(self) -> &'static str {
        match self {
            Self::Space => "3D",
            Self::Image => "2D",
            Self::Figures | Self::ManyFigures => "TimeSeries",
            Self::Text => "TextLog",
        }
    }
}

/// Where the eye is at first, m, so that a room about the start is in view.
const EYE_M: [f32; 3] = [-4.0, -4.0, 3.5];

fn view(kind: Kind, name: &'static str, origin: &'static str) -> Part {
    Part::View { kind, name, origin }
}

fn figures(name: &'static str, origin: &'static str) -> Part {
    view(Kind::Figures, name, origin)
}

fn tabs(parts: Vec<Part>) -> Part {
    Part::Container { kind: ContainerKind::Tabs, parts: parts.into_iter().map(|part| (part, 1.0)).collect() }
}

/// Sends the arrangement; a viewer that does not know it makes its own.
pub(super) fn send(sink: &mut Sink, has_truth: bool, has_depth: bool) {
    let sent = try_send(sink.stream(), &arrangement(has_truth, has_depth));
    sink.keep(sent);
}

fn arrangement(has_truth: bool, has_depth: bool) -> Part {
    let mut images = vec![(view(Kind::Image, "Image", "world/camera/image"), 1.0)];
    if has_depth {
        images.push((view(Kind::Image, "Depth", "world/camera/depth"), 1.0));
    }
    let mut first = Vec::new();
    if has_truth {
        first.extend([figures("Position error", "error/position"), figures("NEES", "error/nees")]);
    }
    first.push(figures("Landmarks", "tracked"));
    if has_depth {
        first.push(figures("Depth scale", "depth_scale"));
    }
    first.push(view(Kind::Text, "Health", "health"));
    let second = vec![
        view(Kind::ManyFigures, "Gyro bias [rad/s], 3 sigma: x red, y green, z blue", "bias/gyro"),
        view(Kind::ManyFigures, "Accelerometer bias [m/s²]", "bias/accel"),
        figures("Time per image", "time_ms"),
    ];
    let above = vec![(view(Kind::Space, "Space", "world"), 1.4), (Part::Container { kind: ContainerKind::Vertical, parts: images }, 1.0)];
    let parts = vec![
        (Part::Container { kind: ContainerKind::Horizontal, parts: above }, 2.2),
        (Part::Container { kind: ContainerKind::Horizontal, parts: vec![(tabs(first), 1.0), (tabs(second), 1.0)] }, 1.0),
    ];
    Part::Container { kind: ContainerKind::Vertical, parts }
}

fn try_send(stream: &RecordingStream, root: &Part) -> Result<(), RecordingStreamError> {
    let (blueprint, storage) = RecordingStreamBuilder::new("libella").enabled(true).blueprint().memory()?;
    blueprint.set_time_sequence("blueprint", 0);
    let mut writer = Writer { stream: &blueprint, count: 0 };
    let name = writer.write(root)?;
    writer.log("viewport", &ViewportBlueprint::new().with_root_container(name.uuid()).with_auto_layout(false).with_auto_views(false))?;
    let id = blueprint.store_info().map(|info| info.store_id);
    let messages = storage.take();
    if let Some(blueprint_id) = id {
        stream.send_blueprint(messages, BlueprintActivationCommand { blueprint_id, make_active: true, make_default: true });
    }
    Ok(())
}

struct Writer<'a> {
    stream: &'a RecordingStream,
    count: u8,
}

/// The name of a part: what it is and its number.
struct Name(&'static str, u8);

impl Name {
    fn uuid(&self) -> Uuid {
        let mut bytes = [0; 16];
        bytes[15] = self.1;
        Uuid { bytes }
    }

    fn path(&self) -> String {
        format!("{}/00000000-0000-0000-0000-0000000000{:02x}", self.0, self.1)
    }
}

impl Writer<'_> {
    fn log(&self, entity: &str, what: &impl AsComponents) -> Result<(), RecordingStreamError> {
        self.stream.log(entity, what)
    }

    /// Writes a part and all that is in it.
    fn write(&mut self, part: &Part) -> Result<Name, RecordingStreamError> {
        match part {
            Part::View { kind, name, origin } => {
                let this = self.name("view");
                self.log(&format!("{}/ViewContents", this.path()), &ViewContents::new(["$origin/**"]))?;
                let view = ViewBlueprint::new(kind.class()).with_display_name(*name).with_space_origin(*origin);
                self.log(&this.path(), &view)?;
                match kind {
                    Kind::Space => {
                        let eye = EyeControls3D::new().with_position(EYE_M).with_look_target([0.0; 3]);
                        self.log(&format!("{}/EyeControls3D", this.path()), &eye)?;
                    }
                    Kind::ManyFigures => self.log(&format!("{}/PlotLegend", this.path()), &PlotLegend::new().with_visible(false))?,
                    Kind::Image | Kind::Figures | Kind::Text => {}
                }
                Ok(this)
            }
            Part::Container { kind, parts } => {
                let mut paths = Vec::new();
                for (part, _) in parts {
                    paths.push(self.write(part)?.path());
                }
                let this = self.name("container");
                let shares = parts.iter().map(|(_, share)| *share);
                let container = ContainerBlueprint::new(*kind).with_contents(paths.iter().map(String::as_str));
                let container = match kind {
                    ContainerKind::Vertical => container.with_row_shares(shares),
                    _ => container.with_col_shares(shares),
                };
                self.log(&this.path(), &container)?;
                Ok(this)
            }
        }
    }

    fn name(&mut self, what: &'static str) -> Name {
        self.count += 1;
        Name(what, self.count)
    }
}
