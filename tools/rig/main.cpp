// reforge-rig: the virtual rig as a program. See --help.
//
// Exit codes: 0 stopped by SIGINT or SIGTERM, 2 usage, 3 a bad rig file or firmware, 4 ports or
// sockets that cannot be made.
#include <signal.h>
#include <sys/signalfd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>

#include "protocols/rig.h"
#include "tools/rig/avr_extruder.h"
#include "tools/rig/board_memory.h"
#include "tools/rig/rig_server.h"
#include "tools/rig/trace.h"

namespace {

using namespace reforge;

constexpr int kUsage = 2;
constexpr int kBadInput = 3;
constexpr int kDevice = 4;

struct Arguments {
  std::string rig, dir, speed = "1", clock, trace, firmware, script;
  bool unhomed = false;
};

int fail(int code, const std::string& sentence) {
  std::cerr << "reforge-rig: " << sentence << '\n';
  return code;
}

// Nothing = "max".
Result<std::optional<double>> parse_speed(const std::string& text) {
  if (text == "max") return std::optional<double>();
  size_t used = 0;
  double factor = 0;
  try {
    factor = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used != text.size() || !std::isfinite(factor) || factor < 0.001 || factor > 1000) {
    return Error{Code::kUsage,
                 "--speed is a factor between 0.001 and 1000, or max; not " + text + "."};
  }
  return std::optional<double>(factor);
}

Result<RigServer::Ports> make_ports(const Arguments& arguments) {
  const std::filesystem::path dir = arguments.dir;
  std::error_code error;
  std::filesystem::create_directories(dir, error);
  if (error) return Error{Code::kDevice, dir.string() + " cannot be made: " + error.message()};
  std::optional<ClockLink> clock;
  if (!arguments.clock.empty()) {
    auto made = ClockLink::listen(arguments.clock);
    if (!made) return made.error();
    clock.emplace(std::move(*made));
  }
  auto modem = ModemLines::listen(dir / "dtr.sock");
  if (!modem) return modem.error();
  auto cnc = PtyPort::create(dir / "cnc");
  if (!cnc) return cnc.error();
  auto extruder = PtyPort::create(dir / "extruder");
  if (!extruder) return extruder.error();
  return RigServer::Ports{std::move(*cnc), std::move(*extruder), std::move(*modem),
                          std::move(clock)};
}

Result<RigScript> read_script(const std::string& file) {
  if (file.empty()) return RigScript();
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  if (!in) return Error{Code::kUnreadable, "The script " + file + " cannot be read."};
  return RigScript::parse(text.str(), file);
}

FileHandle stop_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return FileHandle(signalfd(-1, &signals, SFD_CLOEXEC));
}

int run(const Arguments& arguments) {
  const auto speed = parse_speed(arguments.speed);
  if (!speed) return fail(kUsage, speed.error().sentence);
  if (!*speed && arguments.clock.empty()) {
    return fail(kUsage, "--speed max needs --clock: without it dead-men would mean nothing.");
  }
  const FileHandle stop = stop_signals();
  const auto rig = read_rig(arguments.rig);
  if (!rig) return fail(kBadInput, rig.error().sentence);
  auto script = read_script(arguments.script);
  if (!script) return fail(kBadInput, script.error().sentence);
  auto board = AvrBoard::open(arguments.firmware);
  if (!board) return fail(kBadInput, board.error().sentence);
  (*board)->set_memory(commissioned_memory(*rig));
  std::unique_ptr<TraceFile> trace;
  if (!arguments.trace.empty()) {
    auto created = TraceFile::create(arguments.trace);
    if (!created) return fail(kDevice, created.error().sentence);
    trace = std::move(*created);
  }
  auto ports = make_ports(arguments);
  if (!ports) return fail(kDevice, ports.error().sentence);

  VirtualRig virtual_rig(*rig, !arguments.unhomed, std::make_unique<AvrExtruder>(std::move(*board)),
                         trace.get(), std::move(*script));
  for (const PtyPort* port : {&ports->cnc, &ports->extruder}) {
    std::cout << port->link().string() << " -> " << port->device() << '\n';
  }
  std::cout << "READY" << std::endl;
  const auto say = [](const std::string& sentence) {
    std::cerr << "reforge-rig: " << sentence << std::endl;
  };
  RigServer server(virtual_rig, *ports, {*speed, say});
  server.run(stop.get());
  if (trace && !trace->good()) return fail(kDevice, "The trace could not be written to its end.");
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  std::error_code ignored;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", ignored);
  arguments.firmware = self.parent_path() / "arduino-extruder.elf";

  CLI::App app{
      "The virtual rig: a simulated 5-axis CNC (GRBL, Marlin or Fanuc-like, as the rig file says) "
      "and\n"
      "the real extruder firmware in an AVR simulator, each behind a pseudo-terminal. Prints READY "
      "when both ports are there.\n"
      "Programs that use libserialport need LD_PRELOAD=libreforge-ptyport.so and, for the reset "
      "by\n"
      "DTR, REFORGE_RIG_DTR=DIR/dtr.sock in their environment.",
      "reforge-rig"};
  app.add_option("--rig", arguments.rig, "Rig file")->required();
  app.add_option("--dir", arguments.dir, "Where the ports DIR/cnc and DIR/extruder appear")
      ->required();
  app.add_option("--speed", arguments.speed,
                 "Virtual seconds a second, or max (with --clock; 1 while no daemon is connected)")
      ->capture_default_str();
  app.add_option("--clock", arguments.clock,
                 "Unix socket on which a daemon takes its time from us");
  app.add_option("--trace", arguments.trace, "Where to record what physically happened");
  app.add_option("--script", arguments.script,
                 "What goes wrong and what the operator does, when (FORMATS.md, \"Rig script\")");
  app.add_option("--firmware", arguments.firmware, "Firmware of the extruder board")
      ->capture_default_str();
  app.add_flag("--unhomed", arguments.unhomed, "The CNC starts locked until homed ($H)");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsage;
  }
  return run(arguments);
}
