// The two boards of fault_world.h.
#include <utility>

#include "tests/firmware/desk.h"
#include "tests/firmware/fault_world.h"
#include "tools/rig/avr_board.h"
#include "tools/rig/virtual_time.h"

namespace reforge {
namespace {

constexpr int32_t kModuleTravel_ms = 50;  // scripts are short

class LogicBoard final : public TriedBoard {
 public:
  LogicBoard() {
    Desk::eeprom.fill(0xFF);
    start();
    hot_end_.set_temperature(205);
  }
  void advance_1ms() override {
    desk_->hot_end = hot_end_;
    desk_->filament = filament_;
    if (!hanging_) desk_->run_ms(1);
    desk_->timer.forget_steps();
    if (hanging_ && ++hanging_ms_ > 1000) start();  // the watchdog
    hot_end_.advance(1e-3, may_heat());
  }
  void receive(std::string_view bytes) override {
    if (hanging_) return;
    for (const char c : bytes) desk_->link.receive(static_cast<uint8_t>(c), desk_->now_ms);
  }
  std::string take_bytes() override { return desk_->take_bytes(); }
  void suffer(BoardMishap mishap) override {
    switch (mishap) {
      case BoardMishap::kReset:
      case BoardMishap::kBrownOut:
      case BoardMishap::kPowerCycle:
        return start();
      case BoardMishap::kHang:
        hanging_ = true;
        return;
      case BoardMishap::kSensorConnected:
        return hot_end_.set_sensor(SensorWiring::kConnected);
      case BoardMishap::kSensorOpen:
        return hot_end_.set_sensor(SensorWiring::kOpen);
      case BoardMishap::kSensorShort:
        return hot_end_.set_sensor(SensorWiring::kShort);
      case BoardMishap::kSensorFallenOut:
        return hot_end_.set_sensor(SensorWiring::kFallenOut);
      case BoardMishap::kHeaterBroken:
        return hot_end_.set_heater_power(0);
      case BoardMishap::kFilamentOut:
      case BoardMishap::kFilamentIn:
        filament_ = mishap == BoardMishap::kFilamentIn;
        return;
    }
  }
  int64_t position() const override { return base_ + desk_->timer.position(); }
  int64_t position_since_reset() const override { return desk_->timer.position(); }
  bool may_heat() override { return !hanging_ && desk_->heater_on && desk_->heater.heating(); }
  bool module_open() const override { return desk_->extruder.module() == firmware::Module::kOpen; }
  bool run_permitted() const override { return desk_->extruder.run_permitted(); }

 private:
  void start() {
    if (desk_) base_ = position();
    desk_ = std::make_unique<Desk>();
    desk_->silent = true;
    desk_->by_link = true;
    desk_->tap();
    desk_->store.load(desk_->settings);
    desk_->settings.set(wire::Setting::kModuleTravel, kModuleTravel_ms);
    hanging_ = false;
    hanging_ms_ = 0;
  }

  std::unique_ptr<Desk> desk_;
  HotEnd hot_end_;
  bool filament_ = true;
  bool hanging_ = false;
  int hanging_ms_ = 0;
  int64_t base_ = 0;
};

class RealBoard final : public TriedBoard {
 public:
  explicit RealBoard(std::unique_ptr<AvrBoard> board) : board_(std::move(board)) {
    board_->hot_end().set_temperature(205);
  }
  void advance_1ms() override {
    board_->advance_to(board_->now_ns() / kNsPerMs * kNsPerMs + kNsPerMs);
    board_->take_steps();
    duty_ = board_->take_heater_duty();
    if (std::exchange(resets_, board_->resets_seen()) != board_->resets_seen()) base_ = position();
  }
  void receive(std::string_view bytes) override {
    board_->receive({reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size()});
  }
  std::string take_bytes() override {
    const auto bytes = board_->take_transmitted();
    return {bytes.begin(), bytes.end()};
  }
  void suffer(BoardMishap mishap) override {
    AvrBoard& board = *board_;
    switch (mishap) {
      case BoardMishap::kReset:
      case BoardMishap::kBrownOut:
      case BoardMishap::kPowerCycle:
        board.reset(mishap == BoardMishap::kReset      ? BoardReset::kButton
                    : mishap == BoardMishap::kBrownOut ? BoardReset::kBrownOut
                                                       : BoardReset::kPowerOn);
        base_ = position();
        return;
      case BoardMishap::kHang:
        return board.hang();
      case BoardMishap::kSensorConnected:
        return board.hot_end().set_sensor(SensorWiring::kConnected);
      case BoardMishap::kSensorOpen:
        return board.hot_end().set_sensor(SensorWiring::kOpen);
      case BoardMishap::kSensorShort:
        return board.hot_end().set_sensor(SensorWiring::kShort);
      case BoardMishap::kSensorFallenOut:
        return board.hot_end().set_sensor(SensorWiring::kFallenOut);
      case BoardMishap::kHeaterBroken:
        return board.hot_end().set_heater_power(0);
      case BoardMishap::kFilamentOut:
        return board.set_filament_present(false);
      case BoardMishap::kFilamentIn:
        return board.set_filament_present(true);
    }
  }
  int64_t position() const override { return board_->position(); }
  int64_t position_since_reset() const override { return board_->position() - base_; }
  bool may_heat() override { return duty_ > 0; }
  bool module_open() const override { return board_->outputs().module_relay; }
  bool run_permitted() const override { return board_->outputs().run_permitted; }

 private:
  std::unique_ptr<AvrBoard> board_;
  double duty_ = 0;
  int resets_ = 0;
  int64_t base_ = 0;
};

}  // namespace

std::unique_ptr<TriedBoard> logic_board() {
  return std::make_unique<LogicBoard>();
}

std::unique_ptr<TriedBoard> avr_board(const std::filesystem::path& elf) {
  auto board = AvrBoard::open(elf);
  if (!board) return nullptr;
  return std::make_unique<RealBoard>(std::move(*board));
}

}  // namespace reforge
