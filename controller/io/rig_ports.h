// The rig's two links on their ports: opens them, opens them again after a loss, and carries out
// what the core wants sent. With a virtual rig it also keeps the byte counts that the clock link
// needs.
//
// A port is only ever opened from a timer of the machine's clock, which with a virtual rig means
// between a tick and its answer (FORMATS.md, "Clock link"). A port that is missing is tried again
// each second.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "controller/config.h"
#include "controller/core/action.h"
#include "controller/io/clock.h"
#include "controller/io/rig_links.h"
#include "controller/io/serial_port.h"
#include "controller/io/virtual_clock.h"

namespace reforge {

class RigPorts final : public RigLinks {
 public:
  struct Port {
    std::string path;
    int baud;
    std::optional<int> kept = std::nullopt;  // serial_port.h
  };

  // `virtual_clock` is null on a real rig.
  RigPorts(boost::asio::io_context& io, Clock& clock, VirtualClock* virtual_clock, Port cnc,
           Port extruder, Handlers handlers);

  void begin() override;
  void end() override;
  void perform(const Send& action) override;
  void perform(const DropUnsent& action) override;
  void perform(const Reopen& action) override;
  const std::string& trouble(Link link) const override { return slot(link).trouble; }
  const std::string& path(Link link) const override { return slot(link).port.path; }
  LinkCounts counts() const override;
  bool has_read(std::uint64_t cnc, std::uint64_t extruder) const override;

 private:
  struct Slot {
    Slot(boost::asio::io_context& io, Port wanted, SerialPort::Handlers handlers)
        : port(std::move(wanted)), serial(io, std::move(handlers)) {}
    Port port;
    SerialPort serial;
    std::string trouble = "The port has not been opened yet.";
  };
  Slot& slot(Link link) { return slots_[static_cast<std::size_t>(link)]; }
  const Slot& slot(Link link) const { return slots_[static_cast<std::size_t>(link)]; }
  SerialPort::Handlers handlers_for(Link link);
  void open_at(Link link, Instant when);
  void open(Link link);

  Clock& clock_;
  VirtualClock* virtual_clock_;
  Handlers handlers_;
  std::array<Slot, kLinkCount> slots_;
};

}  // namespace reforge
