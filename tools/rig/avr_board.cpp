#include "tools/rig/avr_board.h"

#include <algorithm>
#include <cassert>
#include <cstdarg>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <string>
#include <utility>

// simavr's headers are C and know nothing of our warnings.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
extern "C" {
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_regbit.h>
}
#pragma GCC diagnostic pop

#if defined(__SANITIZE_ADDRESS__)
#define REFORGE_LEAK_CHECK
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define REFORGE_LEAK_CHECK
#endif
#endif
#ifdef REFORGE_LEAK_CHECK
#include <sanitizer/lsan_interface.h>
#endif

namespace reforge {
namespace {

constexpr int64_t kFrequency = 16'000'000;
constexpr int64_t kByteCycles = kFrequency * 10 / 115'200;
constexpr int kSupplyMv = 5000;
constexpr int kNoiseMv =
    4;  // about one step of the converter, as on a real board: it lets oversampling work
constexpr int64_t kServoMemoryCycles = kFrequency / 25;
constexpr uint8_t kUntouched = 0xC5;  // RAM is filled with it before every start

// Pins by port letter and bit.
struct Pin {
  char port;
  int bit;
};
constexpr Pin kStep = {'B', 1};
constexpr Pin kDirection = {'B', 0};
constexpr Pin kServo = {'B', 2};
constexpr Pin kRelay = {'B', 3};
constexpr Pin kRunPermitted = {'B', 4};
constexpr Pin kReady = {'D', 5};
constexpr Pin kEnable = {'D', 7};
constexpr Pin kHeater = {'D', 6};
constexpr Pin kFilament = {'D', 4};
constexpr Pin kSignals[] = {{'C', 1}, {'C', 2}, {'C', 3}, {'C', 4}};

int64_t to_cycles(int64_t ns) {
  return ns / 125 * 2 + ns % 125 * 2 / 125;
}  // 16 cycles a microsecond
int64_t to_ns(int64_t cycles) {
  return cycles / 2 * 125 + cycles % 2 * 62;
}

// libsimavr 1.6 cannot free all it allocates for a chip; what it allocates is not ours to report.
class NoLeakCheck {
#ifdef REFORGE_LEAK_CHECK
 public:
  NoLeakCheck() {
    __lsan_disable();
  }
  ~NoLeakCheck() {
    __lsan_enable();
  }
#endif
};

void keep_quiet(avr_t*, const int, const char*, va_list) {}

}  // namespace

struct AvrBoard::Chip {
  avr_t* avr = nullptr;
  void (*core_reset)(avr_t*) = nullptr;
  HotEnd hot_end;

  struct Byte {
    int64_t cycle;
    uint8_t value;
  };
  std::deque<Byte> to_board;    // cycle: its last bit is in
  std::deque<Byte> from_board;  // cycle: its stop bit is out
  int64_t receive_free = 0;
  int64_t transmit_start = 0;

  int64_t alarm = 0;  // advance_to must come to life again at this cycle
  bool resetting = false;
  int own_resets = 0;

  bool inputs_lost = false;
  bool hanging = false;
  uint32_t hang_pc = 0;
  uint8_t hang_instruction[2] = {};

  bool step = false, direction = false, enable_low = false, heater = false, servo = false;
  bool relay = false, run_permitted = false, ready = false;
  std::vector<StepEdge> steps;
  int64_t position = 0;
  int flash_bytes = 0, static_ram_bytes = 0;
  uint8_t driven_c = 0, levels_c = 0, driven_d = 0, levels_d = 0;
  int64_t servo_rise = 0, servo_last = 0;
  int servo_pulse_us = 0;
  int64_t thermal_cycle = 0;
  int64_t heater_rise = 0, heater_on_cycles = 0, duty_since = 0;
  uint32_t noise = 1;

  explicit Chip(const HotEndProperties& properties) : hot_end(properties) {}
  ~Chip() {
    if (avr == nullptr) return;
    avr_terminate(avr);  // leaves some 20 kB of interrupt names behind, see NoLeakCheck
    free(avr);
  }

  int64_t now() const { return static_cast<int64_t>(avr->cycle); }

  void thermal_to_now() {
    const int64_t cycles = now() - thermal_cycle;
    thermal_cycle = now();
    if (cycles > 0) hot_end.advance(static_cast<double>(cycles) / kFrequency, heater);
  }

  avr_irq_t* pin_irq(Pin pin) {
    return avr_io_getirq(avr, static_cast<uint32_t>(AVR_IOCTL_IOPORT_GETIRQ(pin.port)), pin.bit);
  }

  static Chip& of(void* param) { return *static_cast<Chip*>(param); }

  // Pins the firmware drives.
  static void on_step(avr_irq_t*, uint32_t value, void* param) {
    Chip& c = of(param);
    const bool high = value & 1;
    if (high == std::exchange(c.step, high) || !high || !c.enable_low) return;
    const int8_t direction = c.direction ? 1 : -1;
    c.steps.push_back({to_ns(c.now()), direction});
    c.position += direction;
  }
  static void on_direction(avr_irq_t*, uint32_t value, void* param) {
    of(param).direction = value & 1;
  }
  static void on_enable(avr_irq_t*, uint32_t value, void* param) {
    of(param).enable_low = !(value & 1);
  }
  static void on_relay(avr_irq_t*, uint32_t value, void* param) { of(param).relay = value & 1; }
  static void on_run(avr_irq_t*, uint32_t value, void* param) {
    of(param).run_permitted = value & 1;
  }
  static void on_ready(avr_irq_t*, uint32_t value, void* param) { of(param).ready = value & 1; }
  static void on_servo(avr_irq_t*, uint32_t value, void* param) {
    Chip& c = of(param);
    const bool high = value & 1;
    if (high == std::exchange(c.servo, high)) return;
    if (high) {
      c.servo_rise = c.now();
    } else {
      c.servo_pulse_us = static_cast<int>((c.now() - c.servo_rise) / (kFrequency / 1'000'000));
      c.servo_last = c.now();
    }
  }
  static void on_heater(avr_irq_t*, uint32_t value, void* param) {
    of(param).set_heater(value & 1);
  }
  void set_heater(bool on) {
    if (on == heater) return;
    thermal_to_now();
    if (on) {
      heater_rise = now();
    } else {
      heater_on_cycles += now() - heater_rise;
    }
    heater = on;
  }

  static void on_transmit(avr_irq_t*, uint32_t value, void* param) {
    Chip& c = of(param);
    // A byte written while another is on the wire waits for it.
    const int64_t free_at = c.from_board.empty() ? 0 : c.from_board.back().cycle;
    c.transmit_start = std::max(c.now(), free_at);
    c.from_board.push_back({c.transmit_start + kByteCycles, static_cast<uint8_t>(value)});
  }

  static void on_adc(avr_irq_t*, uint32_t value, void* param) {
    Chip& c = of(param);
    avr_adc_mux_t mux;
    static_assert(sizeof(value) <= sizeof(mux));
    std::memset(&mux, 0, sizeof mux);
    std::memcpy(&mux, &value, sizeof value);
    if (mux.kind != ADC_MUX_SINGLE || mux.src != 0) return;
    c.thermal_to_now();
    c.noise = c.noise * 1'664'525u + 1'013'904'223u;
    const int noise = static_cast<int>((c.noise >> 16) % (2 * kNoiseMv + 1)) - kNoiseMv;
    const int mv = static_cast<int>(c.hot_end.sensor_mv(kSupplyMv) + 0.5) + noise;
    avr_raise_irq(avr_io_getirq(c.avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0),
                  static_cast<uint32_t>(std::clamp(mv, 0, kSupplyMv)));
  }

  static avr_cycle_count_t on_alarm(avr_t*, avr_cycle_count_t, void*) { return 0; }

  // simavr forgets its cycle timers at a reset, whoever asked for it.
  static void on_reset(avr_t* avr);
  void set_alarm() {
    const int64_t in = std::max<int64_t>(alarm - now(), 1);
    avr_cycle_timer_cancel(avr, on_alarm, this);
    avr_cycle_timer_register(avr, static_cast<avr_cycle_count_t>(in), on_alarm, this);
  }

  // simavr pulls inputs up again at every write to their port unless told who drives them.
  void drive(Pin pin, bool high) {
    uint8_t& mask = pin.port == kFilament.port ? driven_d : driven_c;
    uint8_t& levels = pin.port == kFilament.port ? levels_d : levels_c;
    const uint8_t bit = static_cast<uint8_t>(1 << pin.bit);
    mask = static_cast<uint8_t>(mask | bit);
    levels = static_cast<uint8_t>(high ? levels | bit : levels & ~bit);
    avr_ioport_external_t external;
    external.name = static_cast<unsigned char>(pin.port) & 0x7F;
    external.mask = mask;
    external.value = levels;
    avr_ioctl(avr, static_cast<uint32_t>(AVR_IOCTL_IOPORT_SET_EXTERNAL(pin.port)), &external);
    avr_raise_irq(pin_irq(pin), high ? 1 : 0);
  }

  // A reset clears what the input registers read, and an unchanged level is no news to simavr.
  void drive_again() {
    for (const Pin pin : {kFilament, kSignals[0], kSignals[1], kSignals[2], kSignals[3]}) {
      const uint8_t levels = pin.port == kFilament.port ? levels_d : levels_c;
      const uint32_t high = levels >> pin.bit & 1;
      avr_raise_irq(pin_irq(pin), !high);
      avr_raise_irq(pin_irq(pin), high);
    }
  }

  void connect();
  void run_until(int64_t cycle);
};

void AvrBoard::Chip::on_reset(avr_t* avr) {
  Chip& c = of(avr->custom.data);
  if (c.core_reset) c.core_reset(avr);
  if (!c.resetting) ++c.own_resets;
  if (std::exchange(c.hanging, false)) {
    std::memcpy(avr->flash + c.hang_pc, c.hang_instruction, 2);
  }
  // A chip in reset lets go of its pins: pull-downs switch heater, relay and hold off, the driver
  // sleeps.
  c.set_heater(false);
  c.step = c.servo = c.relay = c.run_permitted = c.ready = c.enable_low = false;
  c.inputs_lost = true;
  c.set_alarm();
}

void AvrBoard::Chip::connect() {
  avr->sleep = [](avr_t*, avr_cycle_count_t) {};
  avr->custom.data = this;
  core_reset = avr->reset;
  avr->reset = on_reset;

  uint32_t flags = 0;
  avr_ioctl(avr, static_cast<uint32_t>(AVR_IOCTL_UART_GET_FLAGS('0')), &flags);
  flags &= ~static_cast<uint32_t>(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
  avr_ioctl(avr, static_cast<uint32_t>(AVR_IOCTL_UART_SET_FLAGS('0')), &flags);

  const std::pair<Pin, avr_irq_notify_t> outputs[] = {
      {kStep, on_step},   {kDirection, on_direction}, {kEnable, on_enable},    {kHeater, on_heater},
      {kServo, on_servo}, {kRelay, on_relay},         {kRunPermitted, on_run}, {kReady, on_ready}};
  for (const auto& [pin, notify] : outputs) avr_irq_register_notify(pin_irq(pin), notify, this);
  avr_irq_register_notify(
      avr_io_getirq(avr, static_cast<uint32_t>(AVR_IOCTL_UART_GETIRQ('0')), UART_IRQ_OUTPUT),
      on_transmit, this);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_adc,
                          this);
  // Open inputs are held high by the board's pull-ups; present filament closes its switch to
  // ground.
  drive(kFilament, false);
  for (const Pin pin : kSignals) drive(pin, true);
}

void AvrBoard::Chip::run_until(int64_t cycle) {
  alarm = cycle;
  set_alarm();
  while (now() < cycle && avr->state != cpu_Crashed && avr->state != cpu_Done) {
    if (std::exchange(inputs_lost, false)) drive_again();
    avr_run(avr);
  }
}

Result<std::unique_ptr<AvrBoard>> AvrBoard::open(const std::filesystem::path& elf,
                                                 const HotEndProperties& properties) {
  using Opened = Result<std::unique_ptr<AvrBoard>>;
  [[maybe_unused]] const NoLeakCheck ours_alone;
  avr_global_logger_set(keep_quiet);
  elf_firmware_t firmware;
  std::memset(&firmware, 0, sizeof firmware);
  if (!std::filesystem::exists(elf) || elf_read_firmware(elf.c_str(), &firmware) != 0) {
    return Opened::fail(Code::kUnreadable,
                        "Cannot load the extruder firmware " + elf.string() + "; build it first.");
  }
  auto chip = std::make_unique<Chip>(properties);
  chip->avr = avr_make_mcu_by_name("atmega328p");
  if (!chip->avr) {
    return Opened::fail(Code::kUnreadable, "This simavr does not know the atmega328p.");
  }
  avr_init(chip->avr);
  avr_load_firmware(chip->avr, &firmware);
  chip->flash_bytes = static_cast<int>(firmware.flashsize);
  chip->static_ram_bytes = static_cast<int>(firmware.datasize + firmware.bsssize);
  free(firmware.flash);
  free(firmware.eeprom);
  for (uint32_t i = 0; i < firmware.symbolcount; ++i) free(firmware.symbol[i]);
  free(firmware.symbol);
  chip->avr->frequency = kFrequency;
  chip->avr->vcc = chip->avr->avcc = chip->avr->aref = kSupplyMv;
  chip->connect();
  std::unique_ptr<AvrBoard> board(new AvrBoard(std::move(chip)));
  board->reset(BoardReset::kPowerOn);
  return board;
}

AvrBoard::AvrBoard(std::unique_ptr<Chip> chip) : chip_(std::move(chip)) {}
AvrBoard::~AvrBoard() = default;

void AvrBoard::set_memory(std::span<const uint8_t> bytes) {
  std::vector<uint8_t> copy(bytes.begin(), bytes.end());
  avr_eeprom_desc_t memory;
  memory.ee = copy.data();
  memory.offset = 0;
  memory.size = static_cast<uint32_t>(copy.size());
  avr_ioctl(chip_->avr, AVR_IOCTL_EEPROM_SET, &memory);
}

int64_t AvrBoard::now_ns() const {
  return to_ns(chip_->now());
}

void AvrBoard::advance_to(int64_t ns) {
  Chip& c = *chip_;
  const int64_t end = to_cycles(ns);
  avr_irq_t* input =
      avr_io_getirq(c.avr, static_cast<uint32_t>(AVR_IOCTL_UART_GETIRQ('0')), UART_IRQ_INPUT);
  while (!c.to_board.empty() && c.to_board.front().cycle <= end) {
    c.run_until(c.to_board.front().cycle);
    const uint8_t value = c.to_board.front().value;
    c.to_board.pop_front();
    avr_raise_irq(input, value);
  }
  c.run_until(end);
  c.thermal_to_now();
}

void AvrBoard::receive(std::span<const uint8_t> bytes) {
  Chip& c = *chip_;
  c.receive_free = std::max(c.receive_free, c.now());
  for (const uint8_t byte : bytes) {
    c.receive_free += kByteCycles;
    c.to_board.push_back({c.receive_free, byte});
  }
}

int64_t AvrBoard::receive_idle_ns() const {
  return to_ns(std::max(chip_->receive_free, chip_->now()));
}

std::vector<uint8_t> AvrBoard::take_transmitted() {
  Chip& c = *chip_;
  std::vector<uint8_t> bytes;
  while (!c.from_board.empty() && c.from_board.front().cycle <= c.now()) {
    bytes.push_back(c.from_board.front().value);
    c.from_board.pop_front();
  }
  return bytes;
}

int64_t AvrBoard::last_transmit_start_ns() const {
  return to_ns(chip_->transmit_start);
}

void AvrBoard::reset(BoardReset cause) {
  Chip& c = *chip_;
  c.thermal_to_now();
  c.resetting = true;
  avr_reset(c.avr);
  c.resetting = false;
  c.to_board.clear();
  c.from_board.clear();
  c.receive_free = c.now();
  std::fill(c.avr->data + c.avr->ioend + 1, c.avr->data + c.avr->ramend + 1, kUntouched);
  avr_regbit_set(c.avr, cause == BoardReset::kPowerOn    ? c.avr->reset_flags.porf
                        : cause == BoardReset::kBrownOut ? c.avr->reset_flags.borf
                                                         : c.avr->reset_flags.extrf);
}

// The instruction it stands at becomes a jump to itself, until the next reset.
void AvrBoard::hang() {
  Chip& c = *chip_;
  if (c.hanging) return;
  c.hang_pc = c.avr->pc;
  std::memcpy(c.hang_instruction, c.avr->flash + c.hang_pc, 2);
  const uint8_t jump_to_itself[2] = {0xFF, 0xCF};
  std::memcpy(c.avr->flash + c.hang_pc, jump_to_itself, 2);
  c.avr->sreg[S_I] = 0;
  c.avr->state = cpu_Running;
  c.hanging = true;
}

int AvrBoard::resets_seen() const {
  return chip_->own_resets;
}
bool AvrBoard::crashed() const {
  return chip_->avr->state == cpu_Crashed;
}

BoardOutputs AvrBoard::outputs() const {
  const Chip& c = *chip_;
  const bool driven = c.now() - c.servo_last < kServoMemoryCycles;
  return {c.heater, c.enable_low, c.relay, driven ? c.servo_pulse_us : 0, c.run_permitted, c.ready};
}

double AvrBoard::take_heater_duty() {
  Chip& c = *chip_;
  if (c.heater) {
    c.heater_on_cycles += c.now() - c.heater_rise;
    c.heater_rise = c.now();
  }
  const int64_t span = c.now() - std::exchange(c.duty_since, c.now());
  const int64_t on = std::exchange(c.heater_on_cycles, 0);
  return span > 0 ? static_cast<double>(on) / static_cast<double>(span) : 0;
}

std::vector<StepEdge> AvrBoard::take_steps() {
  return std::exchange(chip_->steps, {});
}
int64_t AvrBoard::position() const {
  return chip_->position;
}

HotEnd& AvrBoard::hot_end() {
  chip_->thermal_to_now();
  return chip_->hot_end;
}

void AvrBoard::set_filament_present(bool present) {
  chip_->drive(kFilament, !present);
}

void AvrBoard::set_signal(CncSignal signal, bool closed) {
  chip_->drive(kSignals[static_cast<size_t>(signal)], !closed);
}

int AvrBoard::flash_bytes() const {
  return chip_->flash_bytes;
}
int AvrBoard::static_ram_bytes() const {
  return chip_->static_ram_bytes;
}

int AvrBoard::ram_never_used() const {
  const avr_t& avr = *chip_->avr;
  int longest = 0;
  int run = 0;
  for (int at = avr.ioend + 1; at <= avr.ramend; ++at) {
    run = avr.data[at] == kUntouched ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  return longest;
}

}  // namespace reforge
