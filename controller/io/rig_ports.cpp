#include "controller/io/rig_ports.h"

#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <cassert>
#include <utility>

#include "controller/io/service.h"

namespace reforge {
namespace {

constexpr Duration kRetry = std::chrono::seconds(1);

Timer timer_of(Link link) {
  return link == Link::kCnc ? Timer::kReopenCnc : Timer::kReopenExtruder;
}

}  // namespace

RigPorts::RigPorts(boost::asio::io_context& io, Clock& clock, VirtualClock* virtual_clock, Port cnc,
                   Port extruder, Handlers handlers)
    : clock_(clock),
      virtual_clock_(virtual_clock),
      handlers_(std::move(handlers)),
      slots_{Slot(io, std::move(cnc), handlers_for(Link::kCnc)),
             Slot(io, std::move(extruder), handlers_for(Link::kExtruder))} {}

SerialPort::Handlers RigPorts::handlers_for(Link link) {
  return {[this, link](std::string_view bytes) { handlers_.on_bytes(link, bytes); },
          [this, link](const std::string& why) {
            slot(link).trouble = why;
            service::forget(std::string(name(link)));
            spdlog::warn("{} ({}): {}", name(link), path(link), why);
            handlers_.on_lost(link, why);
            open_at(link, clock_.now() + kRetry);
          },
          [this] { handlers_.on_written(); }};
}

void RigPorts::begin() {
  open_at(Link::kCnc, clock_.now());
  open_at(Link::kExtruder, clock_.now());
}

void RigPorts::end() {
  for (const Link link : {Link::kCnc, Link::kExtruder}) {
    clock_.disarm(timer_of(link));
    slot(link).serial.close();
  }
}

void RigPorts::open_at(Link link, Instant when) {
  clock_.wake_at(timer_of(link), when, [this, link] { open(link); });
}

void RigPorts::open(Link link) {
  Slot& here = slot(link);
  assert(virtual_clock_ == nullptr || virtual_clock_->tick_stands());
  if (Status opened = here.serial.open(here.port.path, {here.port.baud, virtual_clock_ == nullptr,
                                                        std::exchange(here.port.kept, {})});
      !opened) {
    if (here.trouble != opened.error().sentence) {
      here.trouble = opened.error().sentence;
      spdlog::warn("{}: {}", name(link), here.trouble);
    }
    open_at(link, clock_.now() + kRetry);
    return;
  }
  if (virtual_clock_ != nullptr) {
    const LinkCounts counts = virtual_clock_->at_tick();
    here.serial.counted_from(link == Link::kCnc ? counts.cnc_in : counts.extruder_in);
  }
  here.trouble.clear();
  service::keep(std::string(name(link)), here.serial.handle());
  spdlog::info("{} ({}): open.", name(link), here.port.path);
  handlers_.on_open(link);
}

void RigPorts::perform(const Send& action) {
  slot(action.link).serial.write(action.bytes, action.urgent);
}

void RigPorts::perform(const DropUnsent& action) {
  slot(action.link).serial.drop_unsent();
}

void RigPorts::perform(const Reopen& action) {
  Slot& here = slot(action.link);
  spdlog::info("{} ({}): opened again: {}", name(action.link), here.port.path, action.sentence);
  service::forget(std::string(name(action.link)));
  here.serial.close();
  here.trouble = action.sentence;
  open_at(action.link, clock_.now());
}

LinkCounts RigPorts::counts() const {
  const SerialPort& cnc = slot(Link::kCnc).serial;
  const SerialPort& extruder = slot(Link::kExtruder).serial;
  return {cnc.bytes_read(), cnc.bytes_written(), extruder.bytes_read(), extruder.bytes_written()};
}

bool RigPorts::has_read(std::uint64_t cnc, std::uint64_t extruder) const {
  const SerialPort& c = slot(Link::kCnc).serial;
  const SerialPort& e = slot(Link::kExtruder).serial;
  return (!c.is_open() || c.bytes_read() >= cnc) && (!e.is_open() || e.bytes_read() >= extruder);
}

}  // namespace reforge
