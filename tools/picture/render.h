// Pictures of solids: an orthographic, flat-shaded view with hidden surfaces removed, written as
// PNG.
//
// Made for a README and for a person at a screen, not for measuring: the view direction is fixed
// per picture, light comes over the viewer's left shoulder, and every pixel is the average of 3 × 3
// samples.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge {

struct Colour {
  double r, g, b;  // 0..1
};

struct ColouredMesh {
  const TriangleMesh* mesh;
  Colour colour;
};

// One panel of a picture; all panels share the scale and the view.
using Panel = std::vector<ColouredMesh>;

struct View {
  double azimuth_deg = -55;   // where the viewer stands, about z from +x
  double elevation_deg = 24;  // above the horizon
  int panel_width = 420;      // pixels
  int panel_height = 420;
};

struct Image {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> rgb;  // row by row from the top
};

// Panels side by side on white, each centred on the common bounding box.
Image render(const std::vector<Panel>& panels, const View& view);
Status write_png(const Image& image, const std::filesystem::path& file);

}  // namespace reforge
