// Whatever bytes arrive on the CNC's and the extruder's link, in whatever pieces, nothing breaks
// and no unsolicited motion is ordered. Input: pieces of (link, length, milliseconds, bytes).
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "controller/core/sequencer.h"

namespace {

const reforge::RigDescription& rig() {
  static const reforge::RigDescription shipped = [] {
    auto read = reforge::read_rig(REFORGE_SOURCE_DIR "/config/rigs/mx220.json");
    if (!read) std::abort();
    return *read;
  }();
  return shipped;
}

void check(reforge::Sequencer& core) {
  for (const reforge::Action& action : core.take_actions()) {
    const auto* send = std::get_if<reforge::Send>(&action);
    // No job, no operator: nothing but questions and holds may go to the CNC.
    if (send && send->link == reforge::Link::kCnc && send->bytes.find('G') != std::string::npos) {
      std::abort();
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using reforge::Link;
  reforge::Sequencer core(rig(), reforge::make_cnc_device(rig().cnc).value(), {});
  reforge::Instant now{};
  core.link_opened(now, Link::kCnc);
  core.link_opened(now, Link::kExtruder);
  check(core);
  for (std::size_t at = 0; at + 3 <= size;) {
    const Link link = data[at] % 2 ? Link::kExtruder : Link::kCnc;
    const bool reopen = data[at] >= 0xF0;
    const std::size_t length = std::min<std::size_t>(data[at + 1], size - at - 3);
    now += std::chrono::milliseconds(data[at + 2]);
    core.tick(now);
    check(core);
    if (reopen) {
      core.link_lost(now, link, "fuzz");
      core.link_opened(now, link);
    }
    core.receive(now, link, {reinterpret_cast<const char*>(data) + at + 3, length});
    check(core);
    at += 3 + length;
  }
  return 0;
}
