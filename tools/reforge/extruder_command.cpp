#include "tools/reforge/extruder_command.h"

#include <poll.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <memory>
#include <string>

#include "protocols/extruder_text.h"
#include "tools/reforge/extruder_port.h"

namespace reforge {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kSoon{5'000};
constexpr milliseconds kTravel{35'000};
constexpr milliseconds kHeatUp{1'300'000};  // the board gives up first

struct ExtruderOptions {
  std::filesystem::path port = "/dev/reforge-extruder";
  double celsius = 0;
  double length_mm = 0;
  double speed_mm_per_s = 0;
  double seconds = 60;
  std::string setting;
  std::int32_t value = 0;
};

using Work = std::function<Status(ExtruderPort&, const ExtruderOptions&)>;

std::int32_t thousandths(double value) {
  return static_cast<std::int32_t>(std::lround(value * 1000));
}

Result<wire::Setting> setting_named(const std::string& name) {
  for (std::uint8_t id = 0; id < wire::kSettingCount; ++id) {
    if (name_of(static_cast<wire::Setting>(id)) == name) return static_cast<wire::Setting>(id);
  }
  return Error{Code::kUsage,
               "There is no setting " + name + "; `reforge extruder settings` lists them."};
}

void print_temperature(const wire::Status& status) {
  if (status.temperature == wire::kTemperatureUnknown) {
    std::printf("temperature unknown");
  } else {
    std::printf("%.1f C", status.temperature / 10.0);
  }
  if (status.target > 0) std::printf(" of %.1f", status.target / 10.0);
}

Status show_status(ExtruderPort& port, const ExtruderOptions&) {
  const auto status = port.status();
  if (!status) return status.error();
  const wire::Banner& banner = port.banner();
  std::printf("firmware %d.%d.%d, last reset: %s, settings %04x\n", banner.version_major,
              banner.version_minor, banner.version_patch,
              std::string(reset_cause_text(banner.reset_cause)).c_str(), banner.config_hash);
  std::printf("%s\n", std::string(sentence_of(status->state)).c_str());
  if (status->fault != wire::Fault::kNone) {
    std::printf("%s\n", std::string(sentence_of(status->fault)).c_str());
  }
  print_temperature(*status);
  std::printf("; %d steps, %d of them retracted; filament %s; the CNC %s\n", status->position,
              status->retracted,
              status->flags & wire::kFlagFilamentPresent ? "present or not watched" : "absent",
              status->flags & wire::kFlagRunPermitted ? "may run" : "is held");
  return Unit{};
}

Status open_module(ExtruderPort& port, const ExtruderOptions& options) {
  std::printf("opening and heating, this may take minutes\n");
  return port.m_code(70, static_cast<std::int32_t>(std::lround(options.celsius * 10)), kHeatUp);
}

Status close_module(ExtruderPort& port, const ExtruderOptions&) {
  return port.m_code(71, 0, kTravel);
}

// A length is a time at a speed; what the board then says it made is printed, for calibration.
Status extrude(ExtruderPort& port, const ExtruderOptions& options) {
  const auto before = port.status();
  if (!before) return before.error();
  if (const Status begun = port.m_code(72, thousandths(options.speed_mm_per_s), kSoon); !begun) {
    return begun.error();
  }
  const double seconds = options.length_mm / options.speed_mm_per_s;
  const Status kept = port.keep(milliseconds(std::llround(seconds * 1000)));
  if (!kept) return kept.error();
  if (const Status ended = port.m_code(73, 0, kSoon); !ended) return ended.error();
  const auto after = port.status();
  const auto per_metre = port.setting(wire::Setting::kStepsPerMetre);
  if (!after) return after.error();
  if (!per_metre) return per_metre.error();
  const int steps = after->position - before->position - before->retracted;
  std::printf("extruded %d steps: %.2f mm by the present steps_per_metre of %d\n", steps,
              steps * 1000.0 / *per_metre, *per_metre);
  return Unit{};
}

Status retract(ExtruderPort& port, const ExtruderOptions& options) {
  if (const Status done = port.m_code(74, thousandths(options.length_mm), kSoon); !done)
    return done;
  return port.m_code(75, 0, kSoon);
}

Status clear(ExtruderPort& port, const ExtruderOptions&) {
  return port.order(wire::pack(wire::Type::kClearFault, 0), kSoon);
}

// Once a second, for tuning the heater.
Status temperature(ExtruderPort& port, const ExtruderOptions& options) {
  for (int second = 0; second <= options.seconds; ++second) {
    const auto status = port.status();
    if (!status) return status.error();
    std::printf("%4d s  ", second);
    print_temperature(*status);
    std::printf("\n");
    std::fflush(stdout);
    if (const Status kept = port.keep(milliseconds(1000)); !kept) return kept.error();
  }
  return Unit{};
}

Status list_settings(ExtruderPort& port, const ExtruderOptions&) {
  for (std::uint8_t id = 0; id < wire::kSettingCount; ++id) {
    const auto value = port.setting(static_cast<wire::Setting>(id));
    if (!value) return value.error();
    std::printf("%-32s %d\n", std::string(name_of(static_cast<wire::Setting>(id))).c_str(), *value);
  }
  return Unit{};
}

Status change_setting(ExtruderPort& port, const ExtruderOptions& options) {
  const auto id = setting_named(options.setting);
  if (!id) return id.error();
  const wire::Frame set = pack(wire::SetSetting{*id, options.value}, 0);
  if (const Status done = port.order(set, kSoon); !done) return done.error();
  if (const Status saved = port.order(wire::pack(wire::Type::kSaveSettings, 0), kSoon); !saved) {
    return saved.error();
  }
  std::printf("%s is %d now, and after a reset\n", options.setting.c_str(), options.value);
  return Unit{};
}

using Run = std::function<void(const Work&)>;

void add_commands(CLI::App& extruder, const std::shared_ptr<ExtruderOptions>& options,
                  const Run& run) {
  const auto add = [&](const char* name, const char* what, const Work& work) {
    CLI::App* command = extruder.add_subcommand(name, what);
    command->callback([run, work] { run(work); });
    return command;
  };
  add("status", "What it is doing", show_status);
  add("open", "M70: open the module and heat", open_module)
      ->add_option("celsius", options->celsius, "target; absent: the board's setting")
      ->check(CLI::Range(50.0, 300.0));
  add("close", "M71: heater off, close the module", close_module);
  CLI::App* out = add("extrude", "M72 for a while, then M73; prints the steps made", extrude);
  out->add_option("mm", options->length_mm, "of filament")
      ->required()
      ->check(CLI::Range(0.1, 500.0));
  out->add_option("--speed", options->speed_mm_per_s, "mm of filament a second")
      ->default_val(2.0)
      ->check(CLI::Range(0.05, 50.0));
  add("retract", "M74 and M75", retract)
      ->add_option("mm", options->length_mm, "of filament; absent: the board's setting")
      ->check(CLI::Range(0.1, 20.0));
  add("clear", "Clear a latched fault whose cause is gone", clear);
  add("temperature", "Print the temperature once a second", temperature)
      ->add_option("seconds", options->seconds)
      ->capture_default_str()
      ->check(CLI::Range(1.0, 86400.0));
  add("settings", "All settings of the board", list_settings);
  CLI::App* set = add("set", "Change a setting and save it in the board", change_setting);
  set->add_option("name", options->setting)->required();
  set->add_option("value", options->value)->required();
}

// A line of a session, as if it stood behind `reforge extruder`.
void obey_line(ExtruderPort& port, const std::string& line) {
  CLI::App app("commands of a session");
  auto options = std::make_shared<ExtruderOptions>();
  app.require_subcommand(1);
  add_commands(app, options, [&](const Work& work) {
    const Status done = work(port, *options);
    std::printf("%s\n", done ? "ok" : done.error().sentence.c_str());
  });
  try {
    app.parse(line);
  } catch (const CLI::ParseError& error) {
    app.exit(error, std::cout, std::cout);
  }
}

// Commands from standard input, with the heartbeat kept between them: an open module left alone
// for three seconds cools down by itself.
Status session(ExtruderPort& port, const ExtruderOptions&) {
  std::string line;
  bool fault = false;
  std::printf("help lists the commands; quit (or the end of input) closes the module\n");
  std::fflush(stdout);
  while (true) {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (::poll(&input, 1, 0) > 0) {
      char c = 0;
      if (::read(STDIN_FILENO, &c, 1) <= 0) break;
      if (c != '\n') {
        line += c;
        continue;
      }
      if (line == "quit") break;
      if (line == "help") line = "--help";
      if (!line.empty()) obey_line(port, line);
      line.clear();
      fault = false;
      std::fflush(stdout);
    } else if (const Status kept = port.keep(milliseconds(100)); !kept && !fault) {
      std::printf("%s\n", kept.error().sentence.c_str());
      std::fflush(stdout);
      fault = true;
      if (!port.status()) return kept;  // not a fault: the board is gone
    }
  }
  const auto status = port.status();
  if (!status) return status.error();
  if (status->state == wire::State::kFault) return Unit{};  // cold already
  return port.m_code(71, 0, kTravel);
}

}  // namespace

void add_extruder_command(CLI::App& app, Outcome& outcome) {
  auto options = std::make_shared<ExtruderOptions>();
  CLI::App* extruder = app.add_subcommand(
      "extruder", "Manual commands to the extruder board, while the daemon does not run");
  extruder->add_option("--port", options->port, "the board's serial port")->capture_default_str();
  extruder->require_subcommand(1);
  const Run run = [options, &outcome](const Work& work) {
    auto port = ExtruderPort::open(options->port);
    if (!port) return report(outcome, port.error());
    if (const Status done = work(*port, *options); !done) report(outcome, done.error());
  };
  add_commands(*extruder, options, run);
  extruder->add_subcommand("session", "Several of these, a line each, with the nozzle kept hot")
      ->callback([run] { run(session); });
}

}  // namespace reforge
