#include "planner/verify/ball_sweep.h"

#include <algorithm>
#include <cmath>
#include <experimental/simd>
#include <limits>

namespace reforge::verify {

BallSweep::BallSweep(const Vec3& a, const Vec3& b, double radius) {
  const Vec3 d = b - a;
  const double across = std::hypot(d.x(), d.y());
  squared = static_cast<float>(radius * radius);
  if (across < 1e-6) {
    ux = 1, uy = 0, length = 0, slope = 0, lean = 0;
    center = static_cast<float>(std::min(a.z(), b.z()) + radius);
    return;
  }
  const double m = d.z() / across;
  ux = static_cast<float>(d.x() / across);
  uy = static_cast<float>(d.y() / across);
  length = static_cast<float>(across);
  slope = static_cast<float>(m);
  lean = static_cast<float>(m / std::sqrt(1 + m * m));
  center = static_cast<float>(a.z() + radius);
}

namespace {

namespace simd = std::experimental;
using Lanes = simd::native_simd<float>;
constexpr int kLanes = static_cast<int>(Lanes::size());

struct Row {
  float x0, step, y;
};

// Height of the swept ball over the columns k .. k + kLanes - 1; +infinity beside it.
template <bool kLevel>
Lanes ball(const BallSweep& s, const Row& r, Lanes k) {
  const Lanes x = r.x0 + k * r.step;
  const Lanes q = s.ux * x + s.uy * r.y;
  const Lanes e = s.ux * r.y - s.uy * x;
  const Lanes section = s.squared - e * e;
  Lanes at = q;
  if constexpr (!kLevel) at -= s.lean * simd::sqrt(simd::max(section, Lanes(0.0f)));
  at = simd::min(simd::max(at, Lanes(0.0f)), Lanes(s.length));
  const Lanes h = section - (q - at) * (q - at);
  Lanes low = s.center + s.slope * at - simd::sqrt(simd::max(h, Lanes(0.0f)));
  simd::where(h < 0.0f, low) = std::numeric_limits<float>::infinity();
  return low;
}

template <bool kLevel>
float row(const BallSweep& s, const Row& r, int n, float* surface, const float* guard,
          float worst) {
  Lanes least(worst);
  Lanes k([](int lane) { return static_cast<float>(lane); });
  int done = 0;
  for (; done + kLanes <= n; done += kLanes, k += static_cast<float>(kLanes)) {
    const Lanes low = ball<kLevel>(s, r, k);
    const Lanes old(surface + done, simd::element_aligned);
    const Lanes limit(guard + done, simd::element_aligned);
    simd::min(low, old).copy_to(surface + done, simd::element_aligned);
    least = simd::min(least, low - limit);
  }
  worst = simd::hmin(least);
  const Lanes rest = ball<kLevel>(s, r, k);
  for (int lane = 0; done + lane < n; ++lane) {
    surface[done + lane] = std::min(surface[done + lane], static_cast<float>(rest[lane]));
    worst = std::min(worst, rest[lane] - guard[done + lane]);
  }
  return worst;
}

}  // namespace

float sweep_row(const BallSweep& sweep, float x0, float step, float y, int n, float* surface,
                const float* guard, float worst) {
  const Row r{x0, step, y};
  return sweep.slope == 0 ? row<true>(sweep, r, n, surface, guard, worst)
                          : row<false>(sweep, r, n, surface, guard, worst);
}

}  // namespace reforge::verify
