#include "planner/reuse/setup_paper.h"

#include <algorithm>
#include <cmath>

#include "planner/reuse/setup.h"

namespace reforge {
namespace {

constexpr int kDirections = 100;
constexpr int kFinest = 5;      // rotations that go on to the fine stage
constexpr double kAbove = 0.5;  // mm, where a bottom's cross-section is taken
constexpr double kOverhang = 50 * M_PI / 180;

struct Candidate {
  Pose pose;
  Vec3 size = Vec3::Zero();      // of M*, turned
  double volume = 0, shape = 0;  // the two terms of the score
};

// Evenly spread points of the sphere: a spiral by the golden angle.
std::vector<Vec3> sphere_directions() {
  std::vector<Vec3> directions;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - (2. * i + 1) / kDirections, r = std::sqrt(1 - z * z);
    const double angle = M_PI * (3 - std::sqrt(5.)) * i;
    directions.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
  }
  return directions;
}

// Area(T): what does not hang over by more than 50 degrees.
double standing_area(const TriangleMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto& v = mesh.vertices;
    const Vec3 cross = (v[b] - v[a]).cross(v[c] - v[a]);
    if (cross.z() >= -std::sin(kOverhang) * cross.norm()) sum += cross.norm() / 2;
  }
  return sum;
}

// Both terms to 0..1 over all candidates, and the highest weighted sum first.
void rank(std::vector<Candidate>& candidates, const ScoreWeights& weights) {
  const auto normalise = [&](double Candidate::*term) {
    double low = 1e300, high = -1e300;
    for (const Candidate& c : candidates) {
      low = std::min(low, c.*term);
      high = std::max(high, c.*term);
    }
    for (Candidate& c : candidates) c.*term = high > low ? (c.*term - low) / (high - low) : 0;
  };
  normalise(&Candidate::volume);
  normalise(&Candidate::shape);
  std::stable_sort(candidates.begin(), candidates.end(), [&](const auto& a, const auto& b) {
    return weights.volume * a.volume + weights.shape * a.shape >
           weights.volume * b.volume + weights.shape * b.shape;
  });
}

}  // namespace

std::optional<Pose> paper_pose(const PoseSampler& sampler, const LoadedPart& initial,
                               const LoadedPart& target, const ScoreWeights& weights,
                               const std::function<bool(const Box3&)>& fits) {
  const Vec3 bottom = section_centroid(initial.mesh, kAbove);
  std::vector<Candidate> coarse;
  for (const Vec3& direction : sphere_directions()) {
    Candidate candidate;
    candidate.pose.rotation =
        Eigen::Quaterniond::FromTwoVectors(direction, Vec3::UnitZ()).toRotationMatrix();
    TriangleMesh turned = target.in_file;
    for (Vec3& vertex : turned.vertices) vertex = candidate.pose.rotation * vertex;
    const Box3 box = bounds(turned);
    const Vec3 foot = section_centroid(turned, box.min().z() + kAbove);
    candidate.pose.translation = Vec3(bottom.x() - foot.x(), bottom.y() - foot.y(), -box.min().z());
    candidate.size = box.sizes();
    if (!fits(box.translated(candidate.pose.translation))) continue;
    candidate.volume = sampler.share(candidate.pose);
    candidate.shape = standing_area(turned);
    coarse.push_back(candidate);
  }
  rank(coarse, weights);
  if (coarse.size() > kFinest) coarse.resize(kFinest);
  std::vector<Candidate> fine;
  const double area_of_target = area(target.in_file);
  for (const Candidate& rotation : coarse) {
    for (int n = 0; n < 25; ++n) {
      Candidate candidate = rotation;
      const Vec3 step(n % 5 - 2, n / 5 - 2, 0);
      candidate.pose.translation += step.cwiseProduct(rotation.size) / 10;
      Box3 box;
      for (const Vec3& vertex : target.in_file.vertices) {
        box.extend(candidate.pose.rotation * vertex + candidate.pose.translation);
      }
      if (!fits(box)) continue;
      candidate.volume = sampler.share(candidate.pose);
      const PoseBase base = sampler.base(candidate.pose);
      const double rest = 1 - base.area_mm2 / area_of_target;
      candidate.shape = (base.highest_z > 0 ? base.lowest_z / base.highest_z : 0) + rest * rest;
      fine.push_back(candidate);
    }
  }
  if (fine.empty()) return std::nullopt;
  rank(fine, weights);
  return fine.front().pose;
}

}  // namespace reforge
