#include "core/bin.h"

namespace binrig {

const char* command_name(BinCommand::Kind kind) {
  switch (kind) {
    case BinCommand::Kind::shake: return "shake";
    case BinCommand::Kind::light: return "light";
    case BinCommand::Kind::clamp: return "clamp";
    case BinCommand::Kind::tilt: return "tilt";
    case BinCommand::Kind::refill: return "refill";
  }
  return "";
}

}  // namespace binrig
