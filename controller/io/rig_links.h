// What the core's actions on its two links are carried out by: real or virtual ports
// (io/rig_ports.h), or a rig simulated in process (io/simulated_rig.h).
//
// Handlers are called in the io_context's thread, never from inside a method of this face.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "controller/core/action.h"
#include "controller/io/virtual_clock.h"

namespace reforge {

class RigLinks {
 public:
  struct Handlers {
    std::function<void(Link)> on_open;
    std::function<void(Link, std::string why)> on_lost;
    std::function<void(Link, std::string_view bytes)> on_bytes;
    std::function<void()> on_written;  // bytes that had to wait are gone
  };

  virtual ~RigLinks() = default;
  virtual void begin() = 0;  // from now on both links are wanted open
  virtual void end() = 0;    // closes them for good
  virtual void perform(const Send& action) = 0;
  virtual void perform(const DropUnsent& action) = 0;
  virtual void perform(const Reopen& action) = 0;

  // Why the link is down; empty while it is up.
  virtual const std::string& trouble(Link link) const = 0;
  virtual const std::string& path(Link link) const = 0;
  // For the clock link of a virtual rig.
  virtual LinkCounts counts() const = 0;
  virtual bool has_read(std::uint64_t cnc, std::uint64_t extruder) const = 0;
};

}  // namespace reforge
