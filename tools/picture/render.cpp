#include "tools/picture/render.h"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace reforge {
namespace {

constexpr int kSamplesPerSide = 3;
constexpr double kMargin = 0.06;  // of the panel, left free around the solids

// Right, up and towards-the-viewer axes of the picture in the part frame.
Eigen::Matrix3d view_axes(const View& view) {
  const double azimuth = view.azimuth_deg * std::numbers::pi / 180;
  const double elevation = view.elevation_deg * std::numbers::pi / 180;
  const Vec3 towards(std::cos(elevation) * std::cos(azimuth),
                     std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
  const Vec3 right = Vec3::UnitZ().cross(towards).normalized();
  Eigen::Matrix3d axes;
  axes.row(0) = right;
  axes.row(1) = towards.cross(right);
  axes.row(2) = towards;
  return axes;
}

double brightness(const Vec3& normal_in_view) {
  static const Vec3 key = Vec3(-0.45, 0.65, 0.62).normalized();
  static const Vec3 fill = Vec3(0.8, 0.1, 0.6).normalized();
  return std::min(1.0, 0.30 + 0.62 * std::max(0.0, normal_in_view.dot(key)) +
                           0.20 * std::max(0.0, normal_in_view.dot(fill)));
}

// A supersampled canvas: colour and depth for each sample.
struct Canvas {
  int width, height;
  std::vector<float> depth;
  std::vector<std::array<float, 3>> colour;

  Canvas(int w, int h)
      : width(w),
        height(h),
        depth(static_cast<std::size_t>(w) * h, -std::numeric_limits<float>::infinity()),
        colour(static_cast<std::size_t>(w) * h, {1, 1, 1}) {}

  void draw(const std::array<Vec3, 3>& corners, const std::array<float, 3>& shade) {
    const Vec3 &a = corners[0], &b = corners[1], &c = corners[2];
    const double twice_area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
    if (std::abs(twice_area) < 1e-12) return;
    const auto first = [](double low, int) {
      return std::max(0, static_cast<int>(std::ceil(low)));
    };
    const auto last = [](double high, int limit) {
      return std::min(limit - 1, static_cast<int>(std::floor(high)));
    };
    const int x0 = first(std::min({a.x(), b.x(), c.x()}), width);
    const int x1 = last(std::max({a.x(), b.x(), c.x()}), width);
    const int y0 = first(std::min({a.y(), b.y(), c.y()}), height);
    const int y1 = last(std::max({a.y(), b.y(), c.y()}), height);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const double wb =
            ((x - a.x()) * (c.y() - a.y()) - (y - a.y()) * (c.x() - a.x())) / twice_area;
        const double wc =
            ((b.x() - a.x()) * (y - a.y()) - (b.y() - a.y()) * (x - a.x())) / twice_area;
        const double wa = 1 - wb - wc;
        if (wa < 0 || wb < 0 || wc < 0) continue;
        const float z = static_cast<float>(wa * a.z() + wb * b.z() + wc * c.z());
        const std::size_t at = static_cast<std::size_t>(y) * width + x;
        if (z > depth[at]) {
          depth[at] = z;
          colour[at] = shade;
        }
      }
    }
  }
};

void draw_mesh(Canvas& canvas, const ColouredMesh& item, const Eigen::Matrix3d& axes,
               const Vec3& centre, double scale) {
  const auto project = [&](const Vec3& point) -> Vec3 {
    const Vec3 seen = axes * (point - centre) * scale;
    return {seen.x() + canvas.width / 2.0, canvas.height / 2.0 - seen.y(), seen.z()};
  };
  for (const auto& t : item.mesh->triangles) {
    const Vec3 &a = item.mesh->vertices[t[0]], &b = item.mesh->vertices[t[1]],
               &c = item.mesh->vertices[t[2]];
    const Vec3 normal = axes * (b - a).cross(c - a).normalized();
    const double light = brightness(normal);
    canvas.draw({project(a), project(b), project(c)}, {static_cast<float>(item.colour.r * light),
                                                       static_cast<float>(item.colour.g * light),
                                                       static_cast<float>(item.colour.b * light)});
  }
}

void average_into(const Canvas& canvas, Image& image, int left) {
  const int width = canvas.width / kSamplesPerSide, height = canvas.height / kSamplesPerSide;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      std::array<float, 3> sum{};
      for (int dy = 0; dy < kSamplesPerSide; ++dy) {
        for (int dx = 0; dx < kSamplesPerSide; ++dx) {
          const auto& sample =
              canvas.colour[static_cast<std::size_t>(y * kSamplesPerSide + dy) * canvas.width +
                            (x * kSamplesPerSide + dx)];
          for (int k = 0; k < 3; ++k) sum[k] += sample[k];
        }
      }
      std::uint8_t* pixel = &image.rgb[3 * (static_cast<std::size_t>(y) * image.width + left + x)];
      for (int k = 0; k < 3; ++k) {
        const double mean = static_cast<double>(sum[k]) / (kSamplesPerSide * kSamplesPerSide);
        pixel[k] = static_cast<std::uint8_t>(std::lround(255 * std::clamp(mean, 0.0, 1.0)));
      }
    }
  }
}

}  // namespace

Image render(const std::vector<Panel>& panels, const View& view) {
  const Eigen::Matrix3d axes = view_axes(view);
  Box3 part;  // common bounding box, part frame
  Box3 seen;  // the same solids in the view's axes
  for (const Panel& panel : panels) {
    for (const ColouredMesh& item : panel) {
      for (const Vec3& vertex : item.mesh->vertices) {
        part.extend(vertex);
        seen.extend(Vec3(axes * vertex));
      }
    }
  }
  Image image;
  image.width = view.panel_width * static_cast<int>(panels.size());
  image.height = view.panel_height;
  image.rgb.assign(static_cast<std::size_t>(3) * image.width * image.height, 255);
  if (part.isEmpty()) return image;

  const Vec3 extent = seen.sizes().cwiseMax(1e-6);
  const double scale = (1 - 2 * kMargin) * kSamplesPerSide *
                       std::min(view.panel_width / extent.x(), view.panel_height / extent.y());
  const Vec3 centre = axes.transpose() * seen.center();
  for (std::size_t i = 0; i < panels.size(); ++i) {
    Canvas canvas(view.panel_width * kSamplesPerSide, view.panel_height * kSamplesPerSide);
    for (const ColouredMesh& item : panels[i]) draw_mesh(canvas, item, axes, centre, scale);
    average_into(canvas, image, static_cast<int>(i) * view.panel_width);
  }
  return image;
}

Status write_png(const Image& image, const std::filesystem::path& file) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_RGB;
  if (!png_image_write_to_file(&png, file.c_str(), 0, image.rgb.data(), 0, nullptr)) {
    return Status::fail(Code::kUnreadable,
                        "cannot write the picture " + file.string() + ": " + png.message);
  }
  return Unit{};
}

}  // namespace reforge
