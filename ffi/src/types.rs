//! What crosses the border, as C sees it.

/// Capacities of an estimator, see `libella_size`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaProfile {
    /// Microcontroller: images of 160 x 120 px, 6 frames, 54 landmarks.
    Micro = 0,
    /// Telephone: images up to 640 x 480 px, 8 frames, 150 landmarks.
    Mobile = 1,
    /// Workstation: images up to 752 x 480 px, 16 frames, 640 landmarks.
    Desktop = 2,
}

/// How a lens bends rays.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaLens {
    /// Pinhole with radial and tangential distortion k1 k2 p1 p2.
    PinholeRadTan = 0,
    /// Equidistant fisheye of Kannala and Brandt, k1 k2 k3 k4.
    KannalaBrandt = 1,
}

/// What became of a call.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaStatus {
    /// Done.
    Ok = 0,
    /// A pointer is null.
    Null = 1,
    /// The memory is smaller than `libella_size` says.
    MemoryTooSmall = 2,
    /// The memory is not aligned to `libella_alignment`.
    Misaligned = 3,
    /// The handle was not made by `libella_init`.
    NotAHandle = 4,
    /// A number of the configuration is unknown, not finite or out of range.
    BadConfig = 5,
    /// A reading is NaN or infinite; nothing has changed.
    NotFinite = 6,
    /// A stamp is not newer than the last of its kind; nothing has changed.
    Stale = 7,
    /// Width, height or stride of the image do not fit each other or the camera; nothing has changed.
    BadImage = 8,
    /// Inertial samples do not reach the image: push samples past it first. Nothing has changed.
    MissingImu = 9,
    /// No room for more inertial samples before the next image, or for as many tracks; nothing has changed.
    Full = 10,
    /// There is no pose: not initialised, or lost.
    NoPose = 11,
    /// Refused for another reason; nothing has changed.
    Refused = 12,
}

/// What became of an image.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaOutcome {
    /// There was no new image to work on.
    NoFrame = 0,
    /// Not initialised yet: waits for inertial samples.
    WaitsForImu = 1,
    /// Not initialised yet: waits for corners that can be followed.
    WaitsForTracks = 2,
    /// Not initialised yet: the camera has not moved enough.
    WaitsForParallax = 3,
    /// Not initialised yet: scale needs acceleration.
    WaitsForExcitation = 4,
    /// Not initialised yet: what the accelerometer measures is far from gravity.
    WaitsForGravity = 5,
    /// Not initialised yet: images and inertial samples contradict each other.
    WaitsForAgreement = 6,
    /// This image completed initialisation.
    Initialised = 7,
    /// The newest pose is estimated.
    Tracked = 8,
    /// The same, and the image stays as a keyframe.
    NewKeyframe = 9,
    /// Too few corners: the pose coasts on inertial samples.
    Coasted = 10,
    /// Tracking was lost; the estimator starts over.
    Lost = 11,
    /// Something newer than this header.
    Other = 12,
    /// Not initialised yet: the start in motion is computed, a piece with each image.
    ComputesItsStart = 13,
}

/// How the estimator is.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaHealth {
    /// No pose yet.
    Initialising = 0,
    /// Images and inertial samples agree.
    Tracking = 1,
    /// Too few corners: the pose coasts on inertial samples.
    Degraded = 2,
    /// Coasted too long; initialises anew with the next data.
    Lost = 3,
}

/// What an estimator has to know, see `libella_config`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LibellaConfig {
    /// A `LibellaProfile`.
    pub profile: u32,
    /// A `LibellaLens`.
    pub lens: u32,
    /// Width of the images, px.
    pub width_px: u32,
    /// Height of the images, px.
    pub height_px: u32,
    /// Focal lengths fx, fy, px.
    pub focal_px: [f32; 2],
    /// Principal point cx, cy, px; the centre of the first pixel is 0, 0.
    pub center_px: [f32; 2],
    /// Distortion, see the lens.
    pub distortion: [f32; 4],
    /// Rotation from camera to body (IMU) coordinates, a Hamilton quaternion w x y z.
    pub body_from_camera_wxyz: [f32; 4],
    /// Position of the camera in the body, m.
    pub camera_in_body_m: [f32; 3],
    /// White noise of the angular rate, rad/s/sqrt(Hz), as in the datasheet.
    pub gyro_noise_density: f32,
    /// White noise of the specific force, m/s^2/sqrt(Hz).
    pub accel_noise_density: f32,
    /// Random walk of the gyro bias, rad/s^2/sqrt(Hz).
    pub gyro_random_walk: f32,
    /// Random walk of the accelerometer bias, m/s^3/sqrt(Hz).
    pub accel_random_walk: f32,
    /// Magnitude of gravity, m/s^2.
    pub gravity_m_s2: f32,
    /// Standard deviation of a corner's position, px.
    pub sigma_px: f32,
    /// An image becomes a keyframe when its corners have moved this far since the last one, rotation apart, px.
    pub keyframe_parallax_px: f32,
    /// Images from one search for planes to the next, 30 is usual; landmarks are drawn to what is found. 0 seeks none.
    pub planes_every: u32,
}

/// What a plane is in a room.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LibellaPlaneClass {
    /// The lowest horizontal plane, and what is level with it.
    Floor = 0,
    /// Horizontal, high above the floor.
    Ceiling = 1,
    /// Vertical.
    Wall = 2,
    /// Horizontal, as high above the floor as a table.
    Table = 3,
    /// Horizontal, none of these.
    OtherPlane = 4,
}

/// Corners of a plane's polygon at most.
pub const LIBELLA_PLANE_CORNERS: usize = 12;

/// A plane of the room: `normal . x + offset_m = 0`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LibellaPlane {
    /// Its name, as long as it is known; a later plane never has it.
    pub id: u32,
    /// What it is.
    pub class_: LibellaPlaneClass,
    /// Unit normal in world.
    pub normal_in_world: [f32; 3],
    /// Distance of the world's origin, with the sign of the side, m.
    pub offset_m: f32,
    /// Landmarks that spoke for it when it was last found.
    pub support: u32,
    /// Corners of its polygon that are filled in.
    pub corner_count: u32,
    /// The polygon in world, m.
    pub corners_in_world_m: [[f32; 3]; LIBELLA_PLANE_CORNERS],
    /// When it was first found, ns.
    pub first_seen_ns: i64,
    /// When it was last found, ns.
    pub last_seen_ns: i64,
}

/// A corner in an image.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LibellaTrack {
    /// Its name: the same in every image that sees it, never used for another corner.
    pub id: u32,
    /// Column, px, as the camera sees it (distorted).
    pub x_px: f32,
    /// Row, px.
    pub y_px: f32,
}

/// The newest state. World is z up and begins at the first pose.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LibellaPose {
    /// Time of the image that it belongs to, ns.
    pub stamp_ns: i64,
    /// Position of the body (IMU) in world, m.
    pub position_in_world_m: [f32; 3],
    /// Rotation from body to world, a Hamilton quaternion w x y z.
    pub world_from_body_wxyz: [f32; 4],
    /// Velocity in world, m/s.
    pub velocity_in_world_m_s: [f32; 3],
    /// Bias of the angular rate, rad/s.
    pub gyro_bias_rad_s: [f32; 3],
    /// Bias of the specific force, m/s^2.
    pub accel_bias_m_s2: [f32; 3],
    /// Standard deviations of rotation (rad, body axes) and position (m, world axes).
    pub sigma: [f32; 6],
}
