// The one interface of a bin, simulated or on a field bus.
#pragma once

#include <memory>
#include <string>

namespace binrig {

struct BinState {
  double time_s = 0;
  double weight_kg = 0;
  bool part_present = false, lid_closed = false, light_on = false, clamped = false, ready = true;
  double tilt_rad = 0;
  int fault = 0;  ///< 0 = none; the device's code
};

struct BinCommand {
  enum class Kind { shake, light, clamp, tilt, refill };
  Kind kind = Kind::shake;
  double value = 1;  ///< light, clamp: 0 off, else on; tilt: rad; shake: strength 0..1; refill: number of parts, 0 = as at first
};
const char* command_name(BinCommand::Kind kind);

/// Commands return when the bin is ready again. A command outside its bounds throws Error; a bin that does not answer
/// is a state with fault != 0.
class Bin {
 public:
  virtual ~Bin() = default;
  virtual BinState state() = 0;
  virtual void command(const BinCommand& command) = 0;
};

}  // namespace binrig
