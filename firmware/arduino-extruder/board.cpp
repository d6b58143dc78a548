#include "firmware/arduino-extruder/board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "firmware/arduino-extruder/critical.h"
#include "protocols/extruder_wire.h"

namespace {

// Port B.
constexpr uint8_t kDirection = 1 << PB0;
constexpr uint8_t kStep = 1 << PB1;
constexpr uint8_t kServo = 1 << PB2;
constexpr uint8_t kRelay = 1 << PB3;
constexpr uint8_t kRunPermitted = 1 << PB4;
constexpr uint8_t kLamp = 1 << PB5;
// Port D.
constexpr uint8_t kFilament = 1 << PD4;
constexpr uint8_t kReady = 1 << PD5;
constexpr uint8_t kHeater = 1 << PD6;
constexpr uint8_t kEnable = 1 << PD7;
// Port C.
constexpr uint8_t kOpen = 1 << PC1;
constexpr uint8_t kExtrude = 1 << PC2;
constexpr uint8_t kRetract = 1 << PC3;
constexpr uint8_t kRunning = 1 << PC4;

constexpr uint16_t kFirstStepTicks = 20;  // 10 us for the driver to see DIR and ENABLE
constexpr uint8_t kServoTickUs = 4;
constexpr uint8_t kServoTicksMin = 4;  // a match must lie ahead when it is set

reforge::firmware::Feeder* g_feeder;
reforge::firmware::Ring<64>
    g_received;  // 5.5 ms at 115200 baud; the main loop looks every millisecond
reforge::firmware::Ring<128> g_transmit;
volatile uint8_t g_milliseconds;
volatile uint8_t g_servo_turns;  // of timer 0 still to come in this pulse
uint16_t g_servo_pulse_us;
uint8_t g_taken_milliseconds;

// Not cleared by the start-up code: .init3 runs before it.
uint8_t g_reset_cause __attribute__((section(".noinit")));

}  // namespace

// Before anything else: a watchdog still running after its own reset would bite again, and the
// heater must be off from the first instruction on.
extern "C" void reforge_first_of_all() __attribute__((naked, used, section(".init3")));
extern "C" void reforge_first_of_all() {
  PORTD = kEnable;
  DDRD = kHeater | kEnable | kReady;
  PORTB = 0;
  DDRB = kDirection | kStep | kServo | kRelay | kRunPermitted | kLamp;
  g_reset_cause = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

// The step pulse lasts as long as the arithmetic between its edges: 4 us, enough for every driver.
ISR(TIMER1_COMPA_vect) {
  if (g_feeder->due()) PORTB |= kStep;
  const uint16_t wait = g_feeder->next();
  if (wait != 0) {
    OCR1A += wait;  // from the last match, not from now: a late step does not delay the next
  } else {
    TIMSK1 &= static_cast<uint8_t>(~(1 << OCIE1A));
  }
  PORTB &= static_cast<uint8_t>(~kStep);
}

// The others let a step through: it may come 4 us late at most, and moving a byte takes longer.
// ISR_NOBLOCK is enough where taking the interrupt clears its flag.
ISR(TIMER0_COMPA_vect, ISR_NOBLOCK) {
  if (g_servo_turns > 0) {
    g_servo_turns = static_cast<uint8_t>(g_servo_turns - 1);
  } else {
    PORTB &= static_cast<uint8_t>(~kServo);
    TIMSK0 = 0;
  }
}

ISR(TIMER2_COMPA_vect, ISR_NOBLOCK) {
  g_milliseconds = static_cast<uint8_t>(g_milliseconds + 1);
}

// The serial port's flags stay until it is served, so its interrupt is masked before others are let
// in. The handler then goes on as an interrupt routine of its own and unmasks at its end.
#define REFORGE_MASK_AND_GO_ON(bit, handler)            \
  __asm__ volatile(                                     \
      "push r24\n"                                      \
      "in r24, __SREG__\n"                              \
      "push r24\n"                                      \
      "lds r24, %0\n"                                   \
      "andi r24, %1\n"                                  \
      "sts %0, r24\n"                                   \
      "pop r24\n"                                       \
      "out __SREG__, r24\n"                             \
      "pop r24\n"                                       \
      "sei\n"                                           \
      "jmp " handler "\n" ::"i"(_SFR_MEM_ADDR(UCSR0B)), \
      "i"(0xFF & ~(1 << (bit))))

extern "C" void __vector_received() __attribute__((signal, used, externally_visible));
extern "C" void __vector_sent() __attribute__((signal, used, externally_visible));

ISR(USART_RX_vect, ISR_NAKED) {
  REFORGE_MASK_AND_GO_ON(RXCIE0, "__vector_received");
}
ISR(USART_UDRE_vect, ISR_NAKED) {
  REFORGE_MASK_AND_GO_ON(UDRIE0, "__vector_sent");
}

void __vector_received() {
  g_received.push(UDR0);
  cli();
  UCSR0B |= 1 << RXCIE0;
}

void __vector_sent() {
  uint8_t byte;
  if (!g_transmit.pop(byte)) return;  // stays masked until there is more
  UDR0 = byte;
  cli();
  UCSR0B |= 1 << UDRIE0;
}

namespace reforge {
namespace firmware {
namespace board {

void begin(Feeder& feeder) {
  g_feeder = &feeder;
  PORTD |= kFilament;
  PORTC = kOpen | kExtrude | kRetract | kRunning;

  // 115200 baud at double speed: 16 MHz / 8 / 17 = 117647, 2.1 % off as on every UNO.
  // The divider comes last: simavr works out the baud rate when it is written.
  UCSR0A = 1 << U2X0;
  UCSR0C = (1 << UCSZ01) | (1 << UCSZ00);
  UBRR0 = 16;
  UCSR0B = (1 << RXEN0) | (1 << TXEN0) | (1 << RXCIE0);

  TCCR1A = 0;
  TCCR1B = 1 << CS11;  // 2 MHz, free running

  TCCR0B = (1 << CS01) | (1 << CS00);  // 250 kHz, free running

  TCCR2A = 1 << WGM21;  // 16 MHz / 64 / 250 = 1 kHz
  TCCR2B = 1 << CS22;
  OCR2A = 249;
  TIMSK2 = 1 << OCIE2A;

  ADMUX = 1 << REFS0;  // AVcc, channel 0
  ADCSRA = (1 << ADEN) | (1 << ADSC) | (1 << ADPS2) | (1 << ADPS1) | (1 << ADPS0);
  DIDR0 = 1 << ADC0D;

  set_sleep_mode(SLEEP_MODE_IDLE);
  wdt_enable(WDTO_1S);
  sei();
}

uint8_t reset_cause() {
  return g_reset_cause;
}

void apply(const Outputs& outputs) {
  uint8_t d = 0;
  if (outputs.heater_on) d |= kHeater;
  if (!outputs.motor_enabled) d |= kEnable;
  if (outputs.ready) d |= kReady;
  uint8_t b = 0;
  if (outputs.relay_open) b |= kRelay;
  if (outputs.run_permitted) b |= kRunPermitted;
  if (outputs.lamp) b |= kLamp;
  g_servo_pulse_us = outputs.servo_pulse_us;
  PORTD = static_cast<uint8_t>((PORTD & ~(kHeater | kEnable | kReady)) | d);
  Critical guard;  // the step interrupt writes port B
  PORTB = static_cast<uint8_t>((PORTB & ~(kRelay | kRunPermitted | kLamp)) | b);
}

Inputs inputs() {
  const uint8_t c = PINC;
  return {!(PIND & kFilament), !(c & kOpen), !(c & kExtrude), !(c & kRetract), !(c & kRunning)};
}

uint8_t elapsed_ms() {
  const uint8_t now = g_milliseconds;
  const uint8_t elapsed = static_cast<uint8_t>(now - g_taken_milliseconds);
  g_taken_milliseconds = now;
  return elapsed;
}

bool thermistor_reading(uint16_t& reading) {
  if (ADCSRA & (1 << ADSC)) return false;
  reading = ADC;
  ADCSRA |= 1 << ADSC;
  return true;
}

void start_steps(bool reversed) {
  const bool high = g_feeder->backward() == reversed;
  Critical guard;
  if (high) {
    PORTB |= kDirection;
  } else {
    PORTB &= static_cast<uint8_t>(~kDirection);
  }
  OCR1A = TCNT1 + kFirstStepTicks;
  TIFR1 = 1 << OCF1A;
  TIMSK1 |= 1 << OCIE1A;
}

// Timer 1 would have room for the pulse, but simavr can lose a match of one of its compare
// registers while the other is written; timer 0 counts whole turns before the last match.
void start_servo_pulse() {
  uint16_t ticks = g_servo_pulse_us / kServoTickUs;
  if (ticks == 0) return;
  if (static_cast<uint8_t>(ticks) < kServoTicksMin) ticks += kServoTicksMin;
  Critical guard;
  PORTB |= kServo;
  g_servo_turns = static_cast<uint8_t>(ticks >> 8);
  OCR0A = static_cast<uint8_t>(TCNT0 + ticks);
  TIFR0 = 1 << OCF0A;
  TIMSK0 = 1 << OCIE0A;
}

bool receive(uint8_t& byte) {
  return g_received.pop(byte);
}
Ring<128>& transmit_ring() {
  return g_transmit;
}

void start_transmit() {
  if (g_transmit.empty()) return;
  Critical guard;
  UCSR0B |= 1 << UDRIE0;
}

Eeprom eeprom() {
  return {
      [](uint16_t address) { return eeprom_read_byte(reinterpret_cast<const uint8_t*>(address)); },
      []() { return static_cast<bool>(eeprom_is_ready()); },
      [](uint16_t address, uint8_t value) {
        eeprom_write_byte(reinterpret_cast<uint8_t*>(address), value);
      }};
}

void feed_watchdog() {
  wdt_reset();
}

void sleep_until_interrupt() {
  cli();
  if (g_received.empty() && g_milliseconds == g_taken_milliseconds) {
    sleep_enable();
    sei();  // takes effect after the next instruction: no interrupt slips in before the sleep
    sleep_cpu();
    sleep_disable();
  }
  sei();
}

}  // namespace board
}  // namespace firmware
}  // namespace reforge
