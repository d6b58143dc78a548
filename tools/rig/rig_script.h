// What goes wrong on the virtual rig, and what its operator does, when: `reforge-rig --script FILE`
// (FORMATS.md, "Rig script").
//
// An entry is due at a time, or a while after the n-th trace record of a kind; each happens once.
// Seconds are virtual. Pure: time and events in, actions out.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"
#include "tools/rig/cnc_controller.h"
#include "tools/rig/extruder_board.h"
#include "tools/rig/faulty_wire.h"

namespace reforge {

enum class Link { kCnc, kExtruder };
constexpr std::array<Link, 2> kLinks{Link::kCnc, Link::kExtruder};

struct RigAction {
  enum class Kind {
    kDrop,
    kFlip,
    kDuplicate,
    kStall,
    kDelay,
    kNoise,
    kUnplug,
    kSwapPorts,
    kBoard,
    kPanel,
  };
  Kind kind;
  Link link = Link::kCnc;
  bool to_host = true, to_device = true;
  double amount = 0;  // bytes or seconds
  WireNoise noise = {};
  BoardMishap mishap = BoardMishap::kReset;
  CncButton button = CncButton::kHold;
  std::string text;  // as written
};

class RigScript {
 public:
  // The error names the line.
  static Result<RigScript> parse(std::string_view text, const std::string& name_for_errors);

  uint64_t seed() const { return seed_; }
  void note(std::string_view event, int64_t now_ns);  // a trace record was written
  std::vector<RigAction> take_due(int64_t now_ns);    // in the order of the file
  bool waiting() const;                               // something has not happened yet

 private:
  struct Entry {
    RigAction action;
    int64_t due_ns = kNeverNs;
    std::string event;  // empty: by time alone
    int count = 0;      // records of that kind still to come
    int64_t delay_ns = 0;
    bool done = false;
  };
  std::vector<Entry> entries_;
  uint64_t seed_ = 1;
};

}  // namespace reforge
