#include "planner/verify/planned_work.h"

#include <cmath>
#include <cstdio>

namespace reforge::verify {
namespace {

// Coordinates are written to 0.001 mm: each end of a move is off by 0.0003 mm (one sigma).
constexpr double kSigmas = 5;
constexpr double kEnd = 0.0003;
constexpr double kLength = 0.02;  // mm, beside that
constexpr double kMoment = 0.03;  // mm^2, beside that
// Ends that share a coordinate, as all of a layer do, share its rounding: the centroid moves by up
// to half a thousandth along each axis.
constexpr double kCentroid = 0.0009;  // mm
constexpr double kBeadShare = 0.002;  // decimals of the flow
constexpr double kBeadLeast = 0.05;   // mm^3

}  // namespace

void PlannedWork::comment(const std::string& text, std::size_t line) {
  Work work;
  Vec3 about;
  if (std::sscanf(text.c_str(), "work %lf about X%lf Y%lf Z%lf beads %lf", &work.length_mm,
                  &about.x(), &about.y(), &about.z(), &work.beads_mm3) != 5) {
    return;
  }
  planned_ = work;  // about the centroid itself the moment is zero
  centre_ = about;
  line_ = line;
}

void PlannedWork::begin(int block, std::size_t line) {
  end(line);
  block_ = block;
}

void PlannedWork::rounded(const Vec3& at, double turned, double length) {
  length_noise_ += turned * turned;
  turned_ += turned;
  turned_moment_ += turned * (at - centre_).norm();
  moment_noise_ += length * length + turned * turned * (at - centre_).squaredNorm();
}

void PlannedWork::add(const Vec3& a, const Vec3& b, double bead_mm3) {
  const double length = (b - a).norm();
  if (length <= 0) return;
  const Vec3 way = (b - a) / length;
  if ((a - last_).squaredNorm() < 1e-12) {
    rounded(a, (way - last_way_).norm(), length);
  } else {
    rounded(last_, last_way_.norm(), 0);
    rounded(a, 1, length);
  }
  last_ = b;
  last_way_ = way;
  done_.length_mm += length;
  done_.moment += length * (0.5 * (a + b) - centre_);
  done_.beads_mm3 += bead_mm3;
}

void PlannedWork::end(std::size_t line) {
  if (planned_) {
    const Work& plan = *planned_;
    rounded(last_, last_way_.norm(), 0);
    const double length = std::fabs(done_.length_mm - plan.length_mm);
    const double moment = done_.moment.norm();
    const double beads = std::fabs(done_.beads_mm3 - plan.beads_mm3);
    const bool agrees =
        length <= kLength + kSigmas * kEnd * std::sqrt(length_noise_) + kEnd * turned_ &&
        moment <= kMoment + kSigmas * kEnd * std::sqrt(moment_noise_) + kCentroid * plan.length_mm +
                      kEnd * turned_moment_ &&
        beads <= kBeadLeast + kBeadShare * plan.beads_mm3;
    if (!agrees) {
      const Vec3 off =
          done_.length_mm > 0 ? Vec3(done_.moment / done_.length_mm) : Vec3(Vec3::Zero());
      const Vec3 is = centre_ + off;
      findings_.add(Fault::kNotAsPlanned, line_, block_, is, off.norm() + length, [&] {
        const auto text = [](const Work& w, const Vec3& c) {
          char words[160];
          std::snprintf(words, sizeof words,
                        "%.3f mm about X%.4f Y%.4f Z%.4f with %.3f mm3 of bead", w.length_mm, c.x(),
                        c.y(), c.z(), w.beads_mm3);
          return std::string(words);
        };
        return "the block was planned to work " + text(plan, centre_) + "; its lines up to " +
               std::to_string(line) + " work " + text(done_, is);
      });
    }
  }
  planned_.reset();
  done_ = {};
  centre_ = last_ = last_way_ = Vec3::Zero();
  length_noise_ = moment_noise_ = turned_ = turned_moment_ = 0;
}

}  // namespace reforge::verify
