from teleported import main as main
