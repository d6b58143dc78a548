#include "planner/reuse/setup_search.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/geometry/convex_hull.h"
#include "planner/reuse/setup.h"

namespace reforge {
namespace {

constexpr double kLeastSide = 0.005;    // of the hull's area, for a side to rest on
constexpr std::size_t kMostRests = 13;  // the stored one included
constexpr int kYaws = 24;
constexpr double kOffset = 0.1;  // of the target's size in x and y, between rough positions
constexpr std::size_t kRefined = 16;
constexpr double kFirstYaw = 2 * M_PI / kYaws / 2, kLastYaw = 0.004;
constexpr double kFirstStep = kOffset / 2, kLastStep = 0.002;  // of the target's size
constexpr double kSnap = 0.02;        // rad; as near to a quarter turn, the exact one is preferred
constexpr double kEqual = 0.002;      // shares that the samples do not tell apart
constexpr double kSymmetric = 0.001;  // between shares
constexpr double kAlike = 0.2;        // rad between poses that are not distinct
constexpr double kAbove = 0.5;        // mm, where a bottom's cross-section is taken

// A way to lie on the base, before yaw and position.
struct Rest {
  Eigen::Matrix3d rotation;
  std::vector<Vec3> hull;       // rotated
  double lift;                  // brings the lowest point to z = 0
  std::array<Vec3, 2> anchors;  // bottom centroid and centre of gravity, rotated
};

struct Parameters {
  std::size_t rest;
  double yaw, x, y;
  double share;
};

Rest make_rest(const LoadedPart& target, const TriangleMesh& hull,
               const Eigen::Matrix3d& rotation) {
  Rest rest;
  rest.rotation = rotation;
  double lowest = 1e300;
  for (const Vec3& point : hull.vertices) {
    rest.hull.push_back(rotation * point);
    lowest = std::min(lowest, rest.hull.back().z());
  }
  rest.lift = -lowest;
  TriangleMesh turned = target.in_file;
  for (Vec3& vertex : turned.vertices) vertex = rotation * vertex;
  rest.anchors = {section_centroid(turned, lowest + kAbove),
                  Vec3(rotation * centre_of_gravity(target.in_file))};
  return rest;
}

// Rotation matrices of CAD parts are meant to be made of 0 and 1.
Eigen::Matrix3d cleaned(Eigen::Matrix3d rotation) {
  Eigen::Matrix3d near = rotation.array().round().matrix();
  return (near - rotation).lpNorm<Eigen::Infinity>() < 1e-5 ? near : rotation;
}

std::vector<Rest> rests_of(const LoadedPart& target) {
  const TriangleMesh hull = convex_hull(target.in_file.vertices);
  std::vector<Rest> rests{
      make_rest(target, hull, target.placement.turned ? yawed(M_PI / 2) : yawed(0))};
  for (const RestingSide& side :
       resting_sides(hull, centre_of_gravity(target.in_file), kLeastSide)) {
    if (rests.size() == kMostRests) break;
    if (side.down.z() < -0.99985) continue;  // the stored orientation
    const auto rotation = Eigen::Quaterniond::FromTwoVectors(side.down, -Vec3::UnitZ());
    rests.push_back(make_rest(target, hull, cleaned(rotation.toRotationMatrix())));
  }
  return rests;
}

Pose pose_of(const std::vector<Rest>& rests, const Parameters& p) {
  const Rest& rest = rests[p.rest];
  return {yawed(p.yaw) * rest.rotation, Vec3(p.x, p.y, rest.lift)};
}

class Search {
 public:
  Search(const PoseSampler& sampler, const LoadedPart& initial, const LoadedPart& target,
         const std::function<bool(const Box3&)>& fits)
      : sampler_(sampler),
        fits_(fits),
        rests_(rests_of(target)),
        anchors_{section_centroid(initial.mesh, kAbove), centre_of_gravity(initial.mesh)},
        size_(bounds(target.in_file).sizes().norm() / std::sqrt(3)) {}

  PoseSearch run(std::size_t wanted) {
    std::vector<Parameters> rough = look_around();
    std::stable_sort(rough.begin(), rough.end(), better);
    std::vector<Parameters> refined = distinct(rough, kRefined);
    for (Parameters& p : refined) p = refine(p);
    std::stable_sort(refined.begin(), refined.end(), better);
    // Images of each other by a symmetry of one of the parts.
    const auto last = std::unique(refined.begin(), refined.end(), [](const auto& a, const auto& b) {
      return a.share - b.share < kSymmetric;
    });
    refined.erase(last, refined.end());
    PoseSearch result;
    for (const Parameters& p : distinct(refined, wanted)) {
      result.best.push_back(pose_of(rests_, p));
    }
    result.poses_tried = tried_;
    return result;
  }

 private:
  static bool better(const Parameters& a, const Parameters& b) { return a.share > b.share; }

  bool possible(const Parameters& p) const {
    const Eigen::Matrix3d turn = yawed(p.yaw);
    Box3 box;
    for (const Vec3& point : rests_[p.rest].hull) box.extend(turn * point);
    return fits_(box.translated(Vec3(p.x, p.y, rests_[p.rest].lift)));
  }

  std::vector<Parameters> look_around() {
    std::vector<Parameters> found;
    for (std::size_t r = 0; r < rests_.size(); ++r) {
      for (int turn = 0; turn < kYaws; ++turn) {
        const double yaw = 2 * M_PI * turn / kYaws;
        Parameters best{r, yaw, 0, 0, -1};
        for (std::size_t a = 0; a < anchors_.size(); ++a) {
          const Vec3 centred = anchors_[a] - yawed(yaw) * rests_[r].anchors[a];
          for (int n = 0; n < 9; ++n) {
            Parameters p{r, yaw, centred.x() + (n % 3 - 1) * kOffset * size_,
                         centred.y() + (n / 3 - 1) * kOffset * size_, 0};
            p.share = sampler_.rough_share(pose_of(rests_, p));
            ++tried_;
            if (p.share > best.share && possible(p)) best = p;
          }
        }
        if (best.share >= 0) found.push_back(best);
      }
    }
    return found;
  }

  Parameters refine(Parameters best) {
    const auto weigh = [&](Parameters p) {
      ++tried_;
      p.share = sampler_.share(pose_of(rests_, p));
      return p;
    };
    best = weigh(best);
    double turn = kFirstYaw, step = kFirstStep * size_;
    while (turn > kLastYaw || step > kLastStep * size_) {
      Parameters next = best;
      for (int n = 0; n < 6; ++n) {
        Parameters p = best;
        const double sign = n % 2 == 0 ? 1 : -1;
        (n < 2 ? p.yaw : n < 4 ? p.x : p.y) += sign * (n < 2 ? turn : step);
        p = weigh(p);
        if (p.share > next.share && possible(p)) next = p;
      }
      if (next.share <= best.share) {
        turn /= 2;
        step /= 2;
      }
      best = next;
    }
    Parameters exact = best;
    exact.yaw = std::round(best.yaw / (M_PI / 2)) * (M_PI / 2);
    if (std::abs(exact.yaw - best.yaw) < kSnap) {
      exact = weigh(exact);
      if (exact.share > best.share - kEqual && possible(exact)) best = exact;
    }
    return best;
  }

  bool alike(const Parameters& a, const Parameters& b) const {
    const Pose p = pose_of(rests_, a), q = pose_of(rests_, b);
    const double angle = Eigen::AngleAxisd(p.rotation.transpose() * q.rotation).angle();
    return angle < kAlike && (p.translation - q.translation).norm() < kOffset * size_;
  }

  std::vector<Parameters> distinct(const std::vector<Parameters>& sorted, std::size_t most) const {
    std::vector<Parameters> kept;
    for (const Parameters& p : sorted) {
      if (kept.size() == most) break;
      const bool is_new =
          std::none_of(kept.begin(), kept.end(), [&](const Parameters& k) { return alike(p, k); });
      if (is_new) kept.push_back(p);
    }
    return kept;
  }

  const PoseSampler& sampler_;
  const std::function<bool(const Box3&)>& fits_;
  std::vector<Rest> rests_;
  std::array<Vec3, 2> anchors_;
  double size_;
  std::size_t tried_ = 0;
};

}  // namespace

Eigen::Matrix3d yawed(double angle) {
  const double quarters = angle / (M_PI / 2);
  double c = std::cos(angle), s = std::sin(angle);
  if (quarters == std::round(quarters)) {
    c = std::round(c);
    s = std::round(s);
  }
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  rotation(0, 0) = rotation(1, 1) = c;
  rotation(0, 1) = -s;
  rotation(1, 0) = s;
  return rotation;
}

PoseSearch search_poses(const PoseSampler& sampler, const LoadedPart& initial,
                        const LoadedPart& target, std::size_t wanted,
                        const std::function<bool(const Box3&)>& fits) {
  return Search(sampler, initial, target, fits).run(wanted);
}

}  // namespace reforge
