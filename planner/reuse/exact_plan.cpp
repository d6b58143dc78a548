#include "planner/reuse/exact_plan.h"

#include <algorithm>
#include <cmath>

#include "planner/geometry/mesh_topology.h"
#include "planner/geometry/plane_cut.h"

namespace reforge {
namespace {

// Whether a piece beyond slot's plane belongs to what the clipping took there.
bool belongs(const FarPiece& piece, const Slot& slot, const Cut& cut, const ClippingModel& model) {
  for (const auto origin : piece.origins) {
    if (std::binary_search(slot.origins.begin(), slot.origins.end(), origin)) return true;
  }
  const VoxelSet& samples = model.samples();
  const VoxelSet inside = sample(piece.surface, samples.grid);
  for (const auto& [i, j, k] : inside.voxels) {
    const auto number = samples.number(i, j, k);
    if (number >= 0 && cut.taken.test(static_cast<std::size_t>(number))) return true;
  }
  return false;
}

// The sample of T_i farthest from its plane that no other cut takes, so that it stays inside its
// piece.
Vec3 seed_of(const ClippingModel& model, const Clipping& clipping, const Cut& cut) {
  BitSet own = cut.taken;
  for (const auto& other : clipping.cuts) {
    if (other && other.get() != &cut) own.subtract(other->taken);
  }
  const BitSet& among = own.any() ? own : cut.taken;
  Vec3 seed = Vec3::Zero();
  double nearest = 1e300;
  for (std::uint32_t i = 0; i < model.samples().size(); ++i) {
    if (!among.test(i)) continue;
    const double above = cut.plane.signed_distance(model.samples().points[i]);
    if (above < nearest) {
      nearest = above;
      seed = model.samples().points[i];
    }
  }
  return seed;
}

std::string at(const Vec3& p) {
  char text[96];
  std::snprintf(text, sizeof text, "(%.1f, %.1f, %.1f) mm", p.x(), p.y(), p.z());
  return text;
}

// An audit's sample as a border of V~_R, as the search's samples are; nothing if a cut made it.
std::optional<SurfaceSample> before_cutting(SurfaceSample sample) {
  if (sample.other == kThenAdded) {
    std::swap(sample.matter, sample.other);
    sample.normal = -sample.normal;
  }
  if (sample.matter == kThenAdded) sample.matter = kReused;
  if (sample.other == kReused || sample.other == kThenAdded) return std::nullopt;  // a cap
  return sample;
}

// Few directions that together serve all of `wanted`: greedily the one that serves most of what is
// left.
std::vector<Vec3> few_directions(const std::vector<Vec3>& directions,
                                 const std::vector<BitSet>& reached, BitSet wanted) {
  std::vector<Vec3> chosen;
  while (wanted.any()) {
    std::size_t best = 0, most = 0;
    for (std::size_t d = 0; d < directions.size(); ++d) {
      BitSet served = reached[d];
      served &= wanted;
      if (served.count() > most) {
        most = served.count();
        best = d;
      }
    }
    if (most == 0) break;  // what is left is out of reach
    chosen.push_back(directions[best]);
    wanted.subtract(reached[best]);
  }
  return chosen;
}

// One component of B with the nozzle direction that serves most of its samples, nearest to its
// normal.
PrintingBase printing_base(const BaseComponent& component,
                           const std::vector<SurfaceSample>& samples,
                           const std::vector<Vec3>& directions, const ReachTable& reach) {
  PrintingBase base;
  base.facets = component.planes;
  base.from_clipping = component.from_clipping;
  base.area_mm2 = component.area_mm2;
  base.point = component.points.front();
  BitSet own(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (std::binary_search(component.facets.begin(), component.facets.end(), samples[i].facet))
      own.set(i);
  }
  double best_score = -1e300;
  for (std::size_t d = 0; d < directions.size(); ++d) {
    BitSet served = reach.nozzle[d];
    served &= own;
    // Every sample served outweighs any lean; among equals the nearest to the normal.
    const double score =
        10 * static_cast<double>(served.count()) + directions[d].dot(component.mean_normal);
    if (score > best_score) {
      best_score = score;
      base.print_direction = directions[d];
    }
  }
  return base;
}

// Printing that V_R does not carry: from the table if it stands there, else a fault.
void check_carried(const CellComplex& complex, const AuditSettings& settings, AuditResult& result) {
  std::vector<std::uint32_t> facets;
  const TriangleMesh added = surface_of(complex, in(kAdded) | in(kThenAdded), &facets);
  std::uint32_t count = 0;
  const auto piece = pieces(added, count);
  struct Hold {
    bool on_reused = false, has_body = false;
    double table_area = 0;
    Vec3 point = Vec3::Zero();
  };
  std::vector<Hold> holds(count);
  for (std::size_t t = 0; t < added.triangles.size(); ++t) {
    Hold& hold = holds[piece[t]];
    const CellFacet& facet = complex.facets[facets[t]];
    hold.on_reused |= facet.front == kReused || facet.back == kReused;
    if (facet.mark == 0 && settings.is_skin[facet.origin]) continue;
    hold.has_body = true;
    const auto& [a, b, c] = added.triangles[t];
    const auto& v = added.vertices;
    hold.point = v[a];
    if (std::max({v[a].z(), v[b].z(), v[c].z()}) > 1e-3) continue;
    hold.table_area += (v[b] - v[a]).cross(v[c] - v[a]).norm() / 2;
  }
  for (const Hold& hold : holds) {
    if (hold.on_reused || !hold.has_body) continue;
    if (hold.table_area > 0 && settings.table_may_carry) {
      PrintingBase base;
      base.facets = {{Vec3::UnitZ(), 0}};
      base.print_direction = Vec3::UnitZ();
      base.point = hold.point;
      base.area_mm2 = hold.table_area;
      base.on_table = true;
      result.bases.push_back(base);
    } else {
      result.faults.push_back(
          "Matter to be printed near " + at(hold.point) + " touches nothing that is kept" +
          (hold.table_area > 0 ? "; only the table is under it, and the fixture leaves no "
                                 "table there."
                               : "."));
    }
  }
}

}  // namespace

Clipping pruned(const ClippingModel& model, const Clipping& clipping) {
  Clipping best = clipping;
  for (std::size_t s = 0; s < clipping.cuts.size(); ++s) {
    if (!best.cuts[s]) continue;
    auto cuts = best.cuts;
    cuts[s] = nullptr;
    Clipping without = model.combine(std::move(cuts));
    if (without.uncovered > 0 || without.kept < best.kept) continue;
    model.count_blocked(without);
    if (!without.feasible() || without.kept != best.kept) continue;
    best = std::move(without);
  }
  return best;
}

Result<ExactClipping> realise(const CellComplex& ideal, const ClippingModel& model,
                              const Clipping& clipping) {
  ExactClipping exact{ideal, {}};
  for (std::size_t s = 0; s < clipping.cuts.size(); ++s) {
    if (!clipping.cuts[s]) continue;
    const Cut& cut = *clipping.cuts[s];
    const auto mark = static_cast<std::uint32_t>(s) + 1;
    const auto used = cut_off(
        exact.complex, cut.plane, kReused, kThenAdded, mark,
        [&](const FarPiece& piece) { return belongs(piece, model.slots()[s], cut, model); });
    if (!used) return used.error();
    exact.planes.push_back({*used, seed_of(model, clipping, cut)});
  }
  set_loose_pieces_free(exact.complex);
  return exact;
}

AuditResult audit(const CellComplex& complex, const AuditSettings& settings) {
  AuditResult result;
  const auto components = printing_bases(complex, settings.is_skin);
  // The bases' own directions first: caps are printed along them.
  std::vector<Vec3> directions = facet_directions(components);
  directions.insert(directions.end(), settings.directions.begin(), settings.directions.end());
  for (const auto& component : components) {
    ++result.counts.bases;
    if (!component.plano_convex) {
      ++result.counts.bases_not_plano_convex;
      result.faults.push_back("The printing base near " + at(component.points.front()) +
                              " is not made of planar facets that bend away from each other.");
      result.bad_origins.insert(result.bad_origins.end(), component.origins.begin(),
                                component.origins.end());
    }
  }
  const auto samples =
      sample_borders(complex, settings.is_skin, settings.sample_distance_mm, settings.seed);
  const TriangleMesh reused = surface_of(complex, in(kReused));
  const TriangleMesh* obstacles[] = {&reused, &settings.fixture};
  BitSet to_cut(samples.size()), to_print(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].needs_cutter(false)) to_cut.set(i);
    if (samples[i].needs_nozzle(false)) to_print.set(i);
  }
  const ReachTable reach =
      reach_of(samples, to_cut, to_print, directions, obstacles, settings.tools, settings.pitch_mm);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const SurfaceSample& sample = samples[i];
    bool is_blocked = false;
    if (to_cut.test(i)) {
      ++result.counts.cutter_points;
      if (!reach.cutter_anywhere.test(i)) {
        const bool beneath = is_beneath_base(sample, settings.tools.ball_radius_mm);
        ++(beneath ? result.counts.beneath_base : result.counts.cutter_blocked);
        is_blocked = !beneath;
      }
    }
    if (to_print.test(i)) {
      ++result.counts.nozzle_points;
      if (!reach.nozzle_anywhere.test(i)) {
        ++result.counts.nozzle_blocked;
        is_blocked = true;
      }
    }
    if (!is_blocked) continue;
    if (const auto original = before_cutting(sample)) {
      result.blocked.push_back(*original);
    } else {
      const std::uint32_t mark = complex.facets[sample.facet].mark;
      if (mark > 0) result.blocked_caps.push_back(mark - 1);
    }
    if (result.faults.size() < 20) {
      result.faults.push_back("No tool direction reaches the surface near " + at(sample.position) +
                              ".");
    }
  }
  for (const auto& component : components) {
    result.bases.push_back(printing_base(component, samples, directions, reach));
  }
  check_carried(complex, settings, result);
  result.cutter_directions = few_directions(directions, reach.cutter, to_cut);
  for (const PrintingBase& base : result.bases) {
    const bool known = std::any_of(result.nozzle_directions.begin(), result.nozzle_directions.end(),
                                   [&](const Vec3& d) { return d == base.print_direction; });
    if (!known) result.nozzle_directions.push_back(base.print_direction);
  }
  for (std::size_t d = 0; d < directions.size(); ++d) {
    for (const Vec3& chosen : result.nozzle_directions) {
      if (directions[d] == chosen) to_print.subtract(reach.nozzle[d]);
    }
  }
  const auto more = few_directions(directions, reach.nozzle, to_print);
  result.nozzle_directions.insert(result.nozzle_directions.end(), more.begin(), more.end());
  return result;
}

}  // namespace reforge
