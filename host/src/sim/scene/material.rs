//! What things are covered with.

/// What a rectangle is covered with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Material {
    /// Worn screed with joints and marks.
    Floor,
    /// White plaster, poor in texture.
    Plaster,
    /// Painted blocks.
    Blocks,
    /// Hanging cloth with folds.
    Curtain,
    /// Wooden panels.
    Wood,
    /// Foam mat.
    Mat,
    /// Printed picture with shapes and lettering.
    Poster,
    /// Calibration board of squares.
    Checkerboard,
    /// Slats of a pallet.
    Pallet,
    /// Cardboard with tape and a label.
    Cardboard,
    /// Sheet metal with rivets and scratches.
    Metal,
    /// Ceiling panels.
    Ceiling,
    /// Printed picture on the floor.
    PlayMat,
    /// Black strip with white patches.
    Tape,
    /// Bright panes in a dark frame: shines.
    Window,
    /// Ribbed heater.
    Radiator,
}

impl Material {
    /// All of them.
    pub const ALL: [Self; 16] = [
        Self::Floor,
        Self::Plaster,
        Self::Blocks,
        Self::Curtain,
        Self::Wood,
        Self::Mat,
        Self::Poster,
        Self::Checkerboard,
        Self::Pallet,
        Self::Cardboard,
        Self::Metal,
        Self::Ceiling,
        Self::PlayMat,
        Self::Tape,
        Self::Window,
        Self::Radiator,
    ];

    /// Name in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Floor => "floor",
            Self::Plaster => "plaster",
            Self::Blocks => "blocks",
            Self::Curtain => "curtain",
            Self::Wood => "wood",
            Self::Mat => "mat",
            Self::Poster => "poster",
            Self::Checkerboard => "checkerboard",
            Self::Pallet => "pallet",
            Self::Cardboard => "cardboard",
            Self::Metal => "metal",
            Self::Ceiling => "ceiling",
            Self::PlayMat => "play_mat",
            Self::Tape => "tape",
            Self::Window => "window",
            Self::Radiator => "radiator",
        }
    }

    /// Light that it sends out itself at reflectance 1, in units of a lit white wall.
    #[must_use]
    pub fn glow(self) -> f32 {
        if self == Self::Window { 3.0 } else { 0.0 }
    }

    /// Share of spots where a corner detector finds something to follow.
    #[must_use]
    pub fn richness(self) -> f64 {
        match self {
            Self::Plaster | Self::Ceiling | Self::Window => 0.15,
            Self::Curtain | Self::Mat | Self::Radiator => 0.35,
            Self::Floor | Self::Metal => 0.6,
            Self::Blocks | Self::Wood | Self::Cardboard => 0.8,
            Self::Poster | Self::Checkerboard | Self::Pallet | Self::PlayMat | Self::Tape => 1.0,
        }
    }
}
