// `"backend": "simulated"`: the daemon's two links end in a CNC and an extruder board simulated in
// process, on the daemon's own clock. For trying out everything around the machine without one.
#pragma once

#include <array>

#include "controller/io/clock.h"
#include "controller/io/rig_links.h"
#include "controller/io/simulated_cnc.h"
#include "controller/io/simulated_extruder.h"

namespace reforge {

class SimulatedRig final : public RigLinks {
 public:
  SimulatedRig(const RigDescription& rig, Clock& clock, Handlers handlers);

  void begin() override;
  void end() override { clock_.disarm(Timer::kSimulatedRig); }
  void perform(const Send& action) override;
  void perform(const DropUnsent&) override {}  // nothing waits here
  void perform(const Reopen& action) override;
  const std::string& trouble(Link link) const override { return trouble_[index(link)]; }
  const std::string& path(Link) const override { return path_; }
  LinkCounts counts() const override { return {}; }
  bool has_read(std::uint64_t, std::uint64_t) const override { return true; }

 private:
  static std::size_t index(Link link) { return static_cast<std::size_t>(link); }
  void wake(Instant when);  // no later than that
  void run();

  Clock& clock_;
  Handlers handlers_;
  SimulatedCnc cnc_;
  SimulatedExtruder extruder_;
  std::string path_ = "simulated";
  std::array<std::string, kLinkCount> trouble_;
  std::array<bool, kLinkCount> to_open_{};
  Instant wakes_at_ = kNever;
};

}  // namespace reforge
